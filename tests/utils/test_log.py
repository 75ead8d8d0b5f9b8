"""The package's logger."""

from tests.programs import run


def test_a_program_that_set_up_no_logging_is_shown_nothing() -> None:
    program = """
        from limberjack.utils.log import log
        log.warning("diverged")
        print(log.name)
    """
    assert run(program) == "limberjack\n"  # `run` fails where there is anything on standard error


def test_a_program_that_set_up_logging_is_shown_warnings() -> None:
    program = """
        import logging, sys
        logging.basicConfig(stream=sys.stdout, format="%(name)s: %(message)s")
        from limberjack.utils.log import log
        log.warning("diverged")
    """
    assert run(program) == "limberjack: diverged\n"
