"""`python -m limberjack` is the command `limberjack`."""

from limberjack.cli import main

if __name__ == "__main__":
    main()
