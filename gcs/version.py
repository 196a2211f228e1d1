"""The version of the installed package."""

from importlib.metadata import PackageNotFoundError, version


def _version() -> str:
    try:
        return version("flight-model-ground-station")
    except PackageNotFoundError:
        return "0+source"


VERSION = _version()
