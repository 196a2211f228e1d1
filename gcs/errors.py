"""Errors of the ground station.

GcsError                       every error a user can cause; its text is one line that says what to do
├── RecordingError             a recording that cannot be opened, read or written
│   ├── ImportFileError        a log of another format that cannot be imported
│   └── DiskFullError          a recording for which the disk has no room
├── DialectError               a MAVLink dialect that is unknown or cannot be loaded
├── LinkError                  a link that cannot be opened or brings nothing
│   └── LinkUrlError           a connection string that is wrong
├── CatalogueError             a flight, model or result that the catalogue does not hold
├── RecordingDeletedError      a recording that was deleted to make room
├── CatalogueFileError         a catalogue whose file cannot be read or written, as on a full disk
│   └── CatalogueBusyError     a catalogue that another program writes for too long
├── JobError                   a job that cannot be started or has failed
│   └── QueueFullError         a job for which too many others wait
├── VehicleError               an aircraft that cannot be kept or changed, or that nobody has chosen
├── SignalMapError             a signal whose message or field does not exist
├── ReportError                a file that is no result, of which a report cannot be made
├── ServiceError               a data folder or port that the service cannot have
│   └── BusyError              what the service does for so many others already that one more has to come again
├── PriorError                 a file of which no prior model can be made
├── StationError               a station asked over REST that does not answer, or refuses
└── SettingsError              a setting, of the command line or the environment, that is missing or impossible
"""


class GcsError(Exception):
    """Base of every error that a user's input can cause."""


class RecordingError(GcsError):
    """A recording cannot be opened, read or written."""


class ImportFileError(RecordingError):
    """A log of another format cannot be imported."""


class DiskFullError(RecordingError):
    """The disk has no room for the recording."""


class DialectError(GcsError):
    """A MAVLink dialect is unknown or cannot be loaded."""


class LinkError(GcsError):
    """A link cannot be opened, or brings nothing."""


class LinkUrlError(LinkError):
    """A connection string is wrong."""


class CatalogueError(GcsError):
    """The catalogue does not hold the flight, model or result asked for."""


class RecordingDeletedError(GcsError):
    """The recording was deleted to make room."""


class CatalogueFileError(GcsError):
    """The catalogue's file cannot be read or written."""


class CatalogueBusyError(CatalogueFileError):
    """Another program writes the catalogue's file for longer than one can wait."""


class JobError(GcsError):
    """A job cannot be started, or has failed."""


class QueueFullError(JobError):
    """Too many other jobs wait."""


class VehicleError(GcsError):
    """An aircraft cannot be kept, changed or estimated as asked, or nobody has said which one it is."""


class SignalMapError(GcsError):
    """A signal names a message or field that does not exist."""


class ServiceError(GcsError):
    """The service cannot have its data folder or its port."""


class BusyError(ServiceError):
    """The service does as much of this for others as it can."""


class ReportError(GcsError):
    """A file is no result, or holds not what its schema says."""


class ExportError(GcsError):
    """A model cannot be written in the form asked for."""


class PriorError(GcsError):
    """A file gives no prior model: it is none of the program's, or its signs are not ours."""


class StationError(GcsError):
    """A station that was asked over REST does not answer, or refuses. status: of HTTP, None where none came."""

    def __init__(self, text: str, status: int | None = None) -> None:
        super().__init__(text)
        self.status = status


class SettingsError(GcsError):
    """A setting, of the command line or the environment, is missing or impossible."""


def in_words(error: Exception) -> str:
    """One line for a log or a page; of an error that nobody thought of it names the kind."""
    text = " ".join(str(error).split())
    return text if isinstance(error, GcsError | OSError) else f"{type(error).__name__}: {text}"
