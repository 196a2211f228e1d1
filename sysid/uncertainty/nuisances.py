"""What disturbs an estimate beside the noise of its sensors: errors of benches, and noise of its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from sysid.output_error.linearisation import Linearised, Others
from sysid.uncertainty.bench_errors import BenchError, Misled, misled
from sysid.uncertainty.thrust_noise import Doubt, doubts


@dataclass(frozen=True)
class Disturbed:
    """An estimate and the errors of benches that it rests on; what they and the inputs' noise do is found once."""

    here: Linearised
    bench: Sequence[BenchError]

    @cached_property
    def misled(self) -> list[Misled]:
        """Of every bench error, what it does."""
        return misled(self.bench, self.here)

    @cached_property
    def doubts(self) -> list[Doubt]:
        """Of every error of thrust and propeller speed, what it does."""
        return doubts(self.here)

    def others(self) -> list[Others]:
        """What all of them do to the residuals of every record."""
        benches = [dict(enumerate(one.added)) for one in self.misled]
        return self.here.others([*benches, *(doubt.outputs for doubt in self.doubts)])
