"""What features are read from: the first terms of a motion over time, in the frame of the body."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

import numpy as np

from modalmotion.mesh import UNKNOWN, spring_modes
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.modes.topologies import CUP
from modalmotion.representation import Complexes, Floats, Ints
from modalmotion.signature.making import ModalSignature, SignatureKind

N_HARMONICS: Final = 2
N_COSINES: Final = 8
"""Terms that are fitted to a cycle and to a transient."""

# Harmonics of a cycle that a smooth motion may have, and twice as many cosines of a transient.
_N_SMOOTH: Final = 3
# Share of the motion below which the last frame repeats the first: what float32 leaves of it.
_REPEATED: Final = 1e-4
# Share of its period that a recording must cover for its phases to follow from the period.
_MOST_OF_PERIOD: Final = 0.75
# Singular values of a design, and directions of a shape, below these shares are undetermined.
_RANK: Final = 1e-8
_FLAT: Final = 1e-6


# Coordinates of the other handedness.
_MIRROR: Final = np.array([-1.0, 1.0, 1.0])
# Levi-Civita's symbol: (_SIGNS @ b) @ a is the cross product of a and b, a @ (_SIGNS @ c) @ b their
# triple product with c; np.cross takes ten times as long for so few numbers.
_SIGNS: Final = np.linalg.det(np.eye(3)[np.indices((3, 3, 3)).transpose(1, 2, 3, 0)])


class Column(NamedTuple):
    """One feature.

    Parameters
    ----------
    name : str
    modes : tuple of int
        Indices of the modes whose motion it is read from; none for what is beside the motion.
    """

    name: str
    modes: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion about its mean over time, in percent of the size of the surface.

    Parameters
    ----------
    signature : ModalSignature
        Of at least two frames.

    Notes
    -----
    The frame of the body follows from the shape at rest, the mean of all frames. Where the
    surface has an axis it is that of the landmarks, and theta is taken right-handed about it;
    elsewhere the amplitudes of the shape in the first modes give its directions.
    """

    signature: ModalSignature

    @property
    def modes(self) -> spring_modes.Modes:
        """Modes of the signature."""
        return self.signature.modes

    @property
    def along_normal(self) -> bool:
        """Whether the amplitudes are of displacements along the normals alone."""
        return self.signature.kind == SignatureKind.NORMAL_DISPLACEMENT

    @cached_property
    def size(self) -> float:
        """Length that amplitudes are compared with, in the unit of the signature."""
        s = self.signature
        return s.modes.length_of(s.lengths, s.angular_frequencies, 1.0)

    @cached_property
    def log_size(self) -> float:
        """Logarithm of the size, in mm where the unit is known."""
        return math.log(max(self.size, 1e-300) * MM_PER_UNIT.get(self.signature.unit or "", 1.0))

    @cached_property
    def shape(self) -> Floats:
        """Amplitudes of the mean shape in the frame of the body, (modes, 3)."""
        turned = self._rest @ self._frame.T
        return np.asarray(turned * self._senses[:, None])

    @cached_property
    def harmonics(self) -> Complexes:
        """First harmonics c_h of sum Re(c_h exp(-i h phase)), (N_HARMONICS, modes, n)."""
        x, share = self.cycle
        n = min(N_HARMONICS, max(1, (len(x) - 1) // 2))
        found = _design(share.tobytes(), n, True).solve[1:] @ x.reshape(len(x), -1)
        terms = np.zeros((N_HARMONICS, *x.shape[1:]), dtype=np.complex128)
        terms[:n] = (found[:n] + 1j * found[n:]).reshape(n, *x.shape[1:])
        return terms

    @cached_property
    def cosines(self) -> Floats:
        """First terms c_k of sum c_k cos(k pi t), (N_COSINES, modes, n)."""
        x = self.amplitudes
        n = min(N_COSINES, len(x) - 1)
        terms = np.zeros((N_COSINES, *x.shape[1:]))
        found = _design(self._elapsed.tobytes(), n, False).solve[1:] @ x.reshape(len(x), -1)
        terms[:n] = found.reshape(n, *x.shape[1:])
        return terms

    @cached_property
    def amount(self) -> float:
        """RMS over time of the deformation, as a share of the size."""
        x = self._deforming
        return math.sqrt(float(np.vdot(x, x)) / len(x)) / 100.0

    def smooth_share(self, is_cycle: bool) -> float:
        """Share of the motion that smooth terms explain beyond what they would of white noise.

        1 for a smooth motion, 0 for noise; 1 where there are too few frames to tell.
        """
        x = self._deforming
        n, total = len(x), float(np.vdot(x, x))
        free = n - 1 - 2 * _N_SMOOTH
        if free < 2 or total == 0.0:
            return 1.0
        is_cycle = is_cycle and len(self.cycle[1]) == n
        time, count = (self.cycle[1], _N_SMOOTH) if is_cycle else (self._elapsed, 2 * _N_SMOOTH)
        explained = _design(time.tobytes(), count, is_cycle).span @ x
        rest = max(0.0, total - float(np.vdot(explained, explained)))
        return max(0.0, 1.0 - rest / free * (n - 1) / total)

    @cached_property
    def largest_step(self) -> float:
        """Largest step between frames of the cycle, the last and the first too, over its extent."""
        x = self.cycle[0].reshape(len(self.cycle[0]), -1)
        extent = float(np.linalg.norm(np.ptp(x, axis=0)))
        steps = np.linalg.norm(x - np.roll(x, 1, axis=0), axis=1)
        return float(steps.max()) / extent if extent > 0.0 else 0.0

    @cached_property
    def volumes(self) -> Floats | None:
        """Volume of a cavity, where one is stated or certain and it stays positive, (frames,)."""
        s = self.signature
        stated = s.facts.cavity
        is_cavity = s.topology == CUP if stated == UNKNOWN else stated != "none"
        if not is_cavity or s.volumes is None or not (s.volumes > 0).all():
            return None
        return s.volumes

    @cached_property
    def log_elongation(self) -> float:
        """Log of the largest extent of the shape over the next; 0 where it is flat."""
        extents = np.linalg.svd(self.shape, compute_uv=False)
        if len(extents) < 2 or not extents[1] > _FLAT * extents[0]:
            return 0.0
        return math.log(extents[0] / extents[1])

    @cached_property
    def cycle(self) -> tuple[Floats, Floats]:
        """One cycle, (frames, modes, n), and the phase of each frame, rad.

        A last frame that repeats the first belongs to the next cycle. Phases follow from the
        period where it is stated and most of it was recorded.
        """
        x, share = self.amplitudes, self._elapsed
        n = len(x)
        if n >= 4:
            steps = [float(np.abs(x[i] - x[j]).max()) for i, j in ((-1, 0), (1, 0), (-1, -2))]
            if steps[0] < _REPEATED * float(np.ptp(x, axis=0).max()) < min(steps[1:]):
                x, share, n = x[:-1] - x[:-1].mean(axis=0), share[:-1] / share[-2], n - 1
        turned = (n - 1) / n
        period, times = self.signature.facts.period, self.signature.times
        if period is not None and times is not None:
            covered = float(times[n - 1] - times[0]) / period
            if _MOST_OF_PERIOD <= covered <= 1.0 + 1e-6:
                turned = covered
        return x, share * (2 * np.pi * turned)

    @cached_property
    def amplitudes(self) -> Floats:
        """Amplitudes about their mean, percent of the size, (frames, modes, n)."""
        a = self._turned(self.signature.amplitudes / self.size) * 100.0
        return np.asarray(a - a.mean(axis=0))

    @cached_property
    def _elapsed(self) -> Floats:
        """Time of each frame, 0 to 1; evenly spaced where there are no times."""
        times, n = self.signature.times, self.signature.n_frames
        if times is None:
            return np.arange(n) / (n - 1)
        return np.asarray((times - times[0]) / (times[-1] - times[0]))

    @cached_property
    def _deforming(self) -> Floats:
        """Amplitudes of modes that do more than move the whole, (frames, values)."""
        moves_whole = not self.along_normal and self.signature.landmarks is not None
        return self.amplitudes[:, int(moves_whole) :].reshape(self.signature.n_frames, -1)

    @cached_property
    def _flip(self) -> Floats:
        """Signs that make coordinates right-handed, where left-handed ones are stated."""
        return _MIRROR if self.signature.facts.handedness == "left" else np.ones(3)

    @cached_property
    def _rest(self) -> Floats:
        """Amplitudes of the mean shape, along normals those of the reference, (modes, 3)."""
        s = self.signature
        mean = 0.0 if self.along_normal else s.amplitudes.mean(axis=0)
        return np.asarray((s.reference_amplitudes + mean) * self._flip)

    @cached_property
    def _frame(self) -> Floats:
        """Rotation from the coordinates of the input to those of the body, (3, 3)."""
        landmarks = self.signature.landmarks
        if landmarks is not None:
            first, axis = landmarks.theta_zero * self._flip, landmarks.axis * self._flip
            return np.stack([first, _SIGNS @ first @ axis, axis])
        rows: list[Floats] = []
        least = _FLAT * float(np.abs(self._rest[1:]).max(initial=0.0))
        # At last any directions, where the shape has none.
        for vector in (*self._rest[1:], *np.eye(3)):
            rest = vector - sum((vector @ row) * row for row in rows)
            if len(rows) < 2 and np.linalg.norm(rest) > max(least, 1e-12):
                rows.append(rest / np.linalg.norm(rest))
        return np.stack([*rows, np.cross(rows[0], rows[1])])

    @cached_property
    def _senses(self) -> Floats:
        """-1 for sines of a theta that runs left-handed about the axis, else 1, (modes,)."""
        senses = np.ones(len(self.modes))
        if self.signature.landmarks is not None:
            c, s = _first_turns(self.modes)
            along = _SIGNS @ (self.signature.landmarks.axis * self._flip)
            if np.vdot(self._rest[c] @ along, self._rest[s]) < 0.0:
                senses[self.modes.is_sine] = -1.0
        return senses

    def _turned(self, vectors: Floats) -> Floats:
        if vectors.shape[-1] == 3:
            vectors = vectors * self._flip @ self._frame.T
        return np.asarray(vectors * self._senses[:, None])


@lru_cache(maxsize=64)
def _first_turns(modes: spring_modes.Modes) -> tuple[Ints, Ints]:
    """Find the cosine and the sine of waves that turn once, (waves,) each."""
    cosines, sines = spring_modes.wave_pairs(modes)
    is_first = (sines >= 0) & (modes.wavenumbers[cosines].sum(axis=1) == 1)
    return cosines[is_first], sines[is_first]


class _Design(NamedTuple):
    """Pseudoinverse of terms over time, and orthonormal trajectories that they can follow."""

    solve: Floats
    span: Floats


@lru_cache(maxsize=64)
def _design(times: bytes, count: int, is_cycle: bool) -> _Design:
    t = np.arange(1, count + 1) * np.frombuffer(times)[:, None]
    columns = [np.cos(t), np.sin(t)] if is_cycle else [np.cos(np.pi * t)]
    design = np.concatenate([np.ones((len(t), 1)), *columns], axis=1)
    U, s, Vt = np.linalg.svd(design, full_matrices=False)
    known = s > _RANK * s[0]
    span = U[:, known].T.copy()
    return _Design((Vt[known].T / s[known]) @ span, span)
