"""What disturbs an estimate beside the noise of its sensors: errors of benches, and noise of its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from sysid.output_error.linearisation import Linearised, NuisanceUnknowns
from sysid.uncertainty.bench_errors import BenchEffect, BenchError, misled
from sysid.uncertainty.thrust_noise import InputError, doubts


@dataclass(frozen=True)
class Disturbed:
    """An estimate and the errors of benches that it rests on; what they and the inputs' noise do is found once."""

    here: Linearised
    bench: Sequence[BenchError]

    @cached_property
    def misled(self) -> list[BenchEffect]:
        """Of every bench error, what it does."""
        return misled(self.bench, self.here)

    @cached_property
    def doubts(self) -> list[InputError]:
        """Of every error of thrust and propeller speed, what it does."""
        return doubts(self.here)

    def others(self) -> list[NuisanceUnknowns]:
        """What all of them do to the residuals of every record."""
        benches = [dict(enumerate(one.added)) for one in self.misled]
        return self.here.others([*benches, *(doubt.outputs for doubt in self.doubts)])
