r"""`encodable`: a text that any file can hold. Names of files may have bytes that are no text.

encodable("walk-\udcff.zip")    # 'walk-\\udcff.zip', with a backslash in the place of the byte
"""

__all__ = ["encodable"]


def encodable(text: str) -> str:
    """The text with a visible escape for each character that UTF-8 cannot encode."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")
