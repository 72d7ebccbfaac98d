"""Some of the data of each frame, kept with a track to be looked at over its surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown
from modalmotion.tracking.information import Information
from modalmotion.tracking.observation import Frame

# Points of one frame, and of all: what a picture shows apart.
_MOST_OF_FRAME: Final = 500
_MOST: Final = 100_000
_LEAST_OF_FRAME: Final = 10

STRAY: Final = 0.1
"""Weight below which a point hardly counted."""

# Consecutive multiples of it fall apart evenly.
_GOLDEN: Final = 0.6180339887498949


@shown("n_points")
@dataclass(frozen=True, eq=False)
class SampledData(FrozenArrays):
    """Points of all frames, one frame after the other; landmarks last in each.

    Parameters
    ----------
    points : (n, 3) float64, length unit
        Of images: the edges that were found.
    weights : (n,) float64
        That each counted with in the estimate, from 0 of a stray to 1; 1 for landmarks.
    are_landmarks : (n,) bool
    counts : (frames,) int64
        Points of each frame.
    """

    points: NDArray[np.float64]
    weights: NDArray[np.float64]
    are_landmarks: NDArray[np.bool_]
    counts: NDArray[np.int64]

    def __post_init__(self) -> None:
        for array in (self.points, self.weights, self.are_landmarks, self.counts):
            array.setflags(write=False)

    @property
    def n_points(self) -> int:
        """Of all frames."""
        return len(self.points)

    def of_frame(self, frame: int) -> slice:
        """Rows of a frame."""
        stop = int(self.counts[: frame + 1].sum())
        return slice(stop - int(self.counts[frame]), stop)


def sample_of(frames: Sequence[Frame], informed: Sequence[Information]) -> SampledData:
    """Take a spread sample of the points of each frame, and all landmarks.

    Parameters
    ----------
    frames : sequence of Frame
    informed : sequence of Information
        Of the same frames: points and the weights that they counted with.

    Returns
    -------
    SampledData
        At most 500 points a frame and some 100,000 in all, beside landmarks.
    """
    most = min(_MOST_OF_FRAME, max(_LEAST_OF_FRAME, _MOST // max(1, len(frames))))
    points, weights, are_landmarks, counts = [np.zeros((0, 3))], [np.zeros(0)], [], []
    for frame, info in zip(frames, informed, strict=True):
        n = len(info.points)
        rows = np.sort(np.argsort(np.arange(n) * _GOLDEN % 1.0, kind="stable")[:most])
        marks = [part.points for part in frame if part.is_landmark]
        n_marks = sum(map(len, marks))
        points += [info.points[rows], *marks]
        weights += [info.weights[rows], np.ones(n_marks)]
        are_landmarks.append(np.repeat([False, True], [len(rows), n_marks]))
        counts.append(len(rows) + n_marks)
    return SampledData(
        np.concatenate(points),
        np.concatenate(weights),
        np.concatenate(are_landmarks),
        np.array(counts, dtype=np.int64),
    )
