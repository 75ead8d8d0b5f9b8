"""Files shared by the domains' models, and `read_model`.

User models may include them and be compiled with `ASSETS`:

    <include file="./common/skybox.xml"/>
    <include file="./common/visual.xml"/>
    <include file="./common/materials.xml"/>
"""

import pathlib

__all__ = ["ASSETS", "read_model"]

_SUITE_DIR = pathlib.Path(__file__).resolve().parent.parent
_SHARED_FILES = ("./common/materials.xml", "./common/skybox.xml", "./common/visual.xml")


def read_model(model_filename: str) -> bytes:
    """Contents of a suite model file, or of any file by absolute path."""
    return (_SUITE_DIR / model_filename).read_bytes()


# Contents of the shared files, by the name used to include them.
ASSETS = {name: read_model(name) for name in _SHARED_FILES}
