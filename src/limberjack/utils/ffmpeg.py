"""`find_ffmpeg`: the ffmpeg program in the wheel of imageio-ffmpeg, with which films are made.

    subprocess.run([find_ffmpeg(), "-i", "film.mp4", ...])

No other file imports imageio_ffmpeg.
"""

from limberjack.utils.requirements import missing_extra

__all__ = ["find_ffmpeg"]


def find_ffmpeg() -> str:
    """The path of the program.

    Raises:
      ImportError: there is none; the message names the packages to install.
    """
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:  # RuntimeError: a wheel without the program
        raise missing_extra("video") from error
