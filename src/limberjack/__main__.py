"""Makes `python -m limberjack` run the `limberjack` command."""

from limberjack.cli import main

if __name__ == "__main__":
    main()
