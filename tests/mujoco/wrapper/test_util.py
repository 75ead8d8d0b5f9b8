"""Text and bytes."""

from limberjack.mujoco.wrapper import util


def test_text_and_bytes() -> None:
    for given in ("größer", "größer".encode()):
        assert util.to_native_string(given) == "größer"
        assert util.to_binary_string(given) == "größer".encode()
