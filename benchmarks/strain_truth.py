"""True strain of a simulated ventricle: lengths of lines and areas of its noise-free lattice.

Written from the definitions of Voigt et al., Eur Heart J Cardiovasc Imaging, 2015, and of nothing
else, so that the product's own strain is judged by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle

Floats = NDArray[np.float64]

# Heights from apex to base of the three levels: the middles of the thirds of the wall.
_CAP = 1 / 8  # of the wall, which the 17th segment has
_LEVELS = {"apical": 1 / 6, "mid": 1 / 2, "basal": 5 / 6}


@dataclass(frozen=True)
class StrainTruth:
    """Strain since end diastole, percent, negative where the wall is shorter.

    Parameters
    ----------
    longitudinal : (frames,) float64
        Of lines from base to base through the apex, the mean of their lengths.
    circumferential : (frames,) float64
        Mean over the three levels.
    by_level : dict of str to (frames,) float64
        Of the circumference at the apical, mid and basal level.
    area : (frames,) float64
        Of the wall.
    end_diastole, end_systole : int
        Frames of the largest and the smallest volume.
    """

    longitudinal: Floats
    circumferential: Floats
    by_level: dict[str, Floats]
    area: Floats
    end_diastole: int
    end_systole: int

    @property
    def gls(self) -> float:
        """Longitudinal strain at end systole."""
        return float(self.longitudinal[self.end_systole])

    @property
    def gcs(self) -> float:
        """Circumferential strain at end systole."""
        return float(self.circumferential[self.end_systole])

    @property
    def gas(self) -> float:
        """Strain of the area at end systole."""
        return float(self.area[self.end_systole])


def strain_truth(clean: MeshSequence, *, by_length: bool = False) -> StrainTruth:
    """Measure a cup lattice without noise whose points follow the tissue.

    Parameters
    ----------
    clean : MeshSequence
        With a grid: row 0 next to the apex, columns around.
    by_length : bool
        Whether a level is at one share of each line's length at end diastole; else it is the
        lattice's row, which wanders about that by 1 to 2 % of the length. Of a surface seen
        without its rows the first is meant: rows of the tissue cannot be seen on it, and their
        strain is another by 0.6 points (RMS).
    """
    assert clean.grid is not None
    rows, columns = clean.grid
    x = clean.vertices.astype(np.float64).reshape(clean.n_frames, rows, columns, 3)
    cavity = cavity_of(clean.faces, clean.n_vertices)
    volumes = np.abs(cavity.volume(clean.vertices.astype(np.float64)))
    start = int(volumes.argmax())
    half = columns // 2
    down = np.linalg.norm(np.diff(x, axis=1), axis=3).sum(axis=1)
    through = np.linalg.norm(x[:, 0, :half] - x[:, 0, half:], axis=2)
    lines = (down[:, :half] + down[:, half:] + through).mean(axis=1)
    heights = np.tile((np.arange(rows) + 0.5) / rows, (columns, 1))
    if by_length:
        reach = np.linalg.norm(x[start, 0] - x[start, 0].mean(axis=0), axis=1)
        steps = np.linalg.norm(np.diff(x[start], axis=0), axis=2)
        lengths = np.cumsum(np.vstack([reach, steps]), axis=0)
        heights = (lengths / lengths[-1]).T
    by_level = {name: _strain(_around(x, heights, level), start) for name, level in _LEVELS.items()}
    return StrainTruth(
        longitudinal=_strain(lines, start),
        circumferential=np.mean(list(by_level.values()), axis=0),
        by_level=by_level,
        area=_strain(_areas(clean), start),
        end_diastole=start,
        end_systole=int(volumes.argmin()),
    )


def fine_twin(
    parameters: VentricleParameters, seed: int | list[int], acquisition: Acquisition
) -> MeshSequence:
    """Simulate the individual of a generator's state on a lattice that strain converges on.

    For the truth of triangulations, clouds, contours and images of it: each mesh's contraction is
    solved for its own polyhedron's ejection fraction, which moves strain by 0.1 points.
    """
    clean = replace(acquisition, noise=0.0)
    rng = np.random.default_rng(seed)
    return simulate_ventricle(parameters, grid=(96, 192), acquisition=clean, rng=rng)


def dyssynchrony_truth(clean: MeshSequence) -> float:
    """Deviation of the times of least volume of 16 segments, % of the cycle (Kapetanakis 2005).

    Parameters
    ----------
    clean : MeshSequence
        A cup lattice of one cycle, in so many frames that they do not matter.
    """
    assert clean.grid is not None
    rows, columns = clean.grid
    x = clean.vertices.astype(np.float64).reshape(clean.n_frames, rows, columns, 3)
    middles = x.mean(axis=2, keepdims=True)
    sectors = np.cross(x - middles, np.roll(x, -1, axis=2) - middles) / 2.0
    pieces = (sectors * np.gradient(middles, axis=1)).sum(axis=3)
    heights = (np.arange(rows) + 0.5) / rows
    turn = (np.arange(columns) + 0.5) / columns
    times = []
    for ring, parts in enumerate((4, 6, 6)):
        low, high = _CAP + (1 - _CAP) * np.array([ring, ring + 1]) / 3
        within = (heights >= low) & (heights < high)
        for part in range(parts):
            own = pieces[:, within][:, :, np.floor(parts * turn) == part].sum(axis=(1, 2))
            times.append(float(np.abs(own).argmin()) / clean.n_frames)
    return float(100.0 * np.std(times, ddof=1))


def _around(x: Floats, heights: Floats, level: float) -> Floats:
    """Length of the line around that crosses each column at a height, (frames,)."""
    columns = np.arange(x.shape[2])
    rows = np.array([np.interp(level, own, np.arange(x.shape[1])) for own in heights])
    below, share = np.floor(rows).astype(int), (rows % 1.0)[:, None]
    line = (1 - share) * x[:, below, columns] + share * x[:, below + 1, columns]
    lengths: Floats = np.linalg.norm(line - np.roll(line, 1, axis=1), axis=2).sum(axis=1)
    return lengths


def _strain(lengths: Floats, start: int) -> Floats:
    strain: Floats = 100.0 * (lengths / lengths[start] - 1.0)
    return strain


def _areas(clean: MeshSequence) -> Floats:
    a, b, c = (clean.vertices[:, clean.faces[:, k]].astype(np.float64) for k in range(3))
    areas: Floats = np.linalg.norm(np.cross(b - a, c - a), axis=2).sum(axis=1) / 2.0
    return areas
