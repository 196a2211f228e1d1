"""A model as an FMU: one file that tools of the FMI standard fly."""

from gcs.exports.fmu.writing import EFFECTS_HELD, write

__all__ = ["EFFECTS_HELD", "write"]
