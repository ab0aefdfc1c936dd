"""The user's cache folder, and in it the one of compiled code."""

import os
from pathlib import Path
from tempfile import TemporaryFile

import platformdirs

FOLDER_VARIABLE, CODE_VARIABLE = "SDM_DEFLECT_CACHE", "NUMBA_CACHE_DIR"
WRITABLE_BY_OTHERS = 0o022


def default_folder() -> Path:
    """The folder named by the environment variable SDM_DEFLECT_CACHE, or the user's cache folder."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else Path(platformdirs.user_cache_dir("sdm-deflect", appauthor=False))


def code_folder() -> Path:
    """The folder of compiled code: NUMBA_CACHE_DIR, Numba's own variable, or `numba` in the cache folder."""
    named = os.environ.get(CODE_VARIABLE)
    return Path(named) if named else default_folder() / "numba"


def code_complaint() -> str:
    """Make the folder of compiled code; return why none can be kept there, empty if it can.

    Whoever can write there can have us run code, so a folder that the user did not name must be the user's alone.
    """
    folder = code_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
        status = folder.stat()
    except OSError as error:
        return error.strerror or str(error)
    private = status.st_uid == os.geteuid() and not status.st_mode & WRITABLE_BY_OTHERS
    return "" if private or os.environ.get(CODE_VARIABLE) else "other users can write there"


def code_files() -> list[Path]:
    """The files of compiled code in the cache folder; none of those where NUMBA_CACHE_DIR is, which others share."""
    return sorted((default_folder() / "numba").glob("*/*/*.nb[ci]"))
