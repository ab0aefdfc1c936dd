"""Times taken side by side, so that a busy machine slows all of them alike."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Action = Callable[[], object]


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """Seconds of several actions that took turns."""

    names: tuple[str, ...]
    seconds: FloatArray  # (rounds, actions)

    def of(self, name: str) -> FloatArray:
        """Return the seconds (rounds,) of one action."""
        return self.seconds[:, self.names.index(name)]

    def median(self, name: str) -> float:
        """Return the median of one action's seconds."""
        return float(np.median(self.of(name)))

    def ratio(self, other: str, ours: str) -> float:
        """Return the median over the rounds of the other's seconds over ours."""
        return float(np.median(self.of(other) / self.of(ours)))


def warm(actions: Mapping[str, Action]) -> None:
    """Run each action once: machine code is loaded or compiled, threads are started, memory is touched."""
    for action in actions.values():
        action()


def side_by_side(actions: Mapping[str, Action], rounds: int, settling: float = 0.0) -> Times:
    """Run all actions in turn, `rounds` times, each untimed for so many seconds before it is timed once."""
    rows = [[_seconds(action, settling) for action in actions.values()] for _ in range(rounds)]
    return Times(tuple(actions), np.array(rows))


def _seconds(action: Action, settling: float) -> float:
    start = perf_counter()
    while perf_counter() - start < settling:
        action()
    start = perf_counter()
    action()
    return perf_counter() - start


def processor_seconds() -> float:
    """Return the processor seconds of this process and of all that it has waited for: others do not stretch them."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def exponent(sizes: list[int], seconds: list[float]) -> float:
    """Return p of the least-squares fit seconds ~ sizes**p."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
