"""Text drawn over a picture."""

import pytest

from limberjack.mujoco.camera import (
    TextOverlay,
)


def test_an_unknown_style_or_position_of_text_is_refused() -> None:
    with pytest.raises(ValueError, match=r"style is 'bigg'.*Did you mean 'big'"):
        TextOverlay(style="bigg")
    with pytest.raises(ValueError, match="position is 'centre'"):
        TextOverlay(position="centre")
