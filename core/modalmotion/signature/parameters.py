"""Request for a signature: number of modes, reference and limits; and the time that it takes."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import InitVar, dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property, partial
from typing import Any, Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.arguments.checking import one_of, real, truth, whole
from modalmotion.formats.detect import Format
from modalmotion.mesh import sequence
from modalmotion.modes.topologies import MESH, Topology
from modalmotion.representation import shown
from modalmotion.template import GivenLandmarks, body_frame
from modalmotion.template.landmarks import landmarks_in

# Above this a signature is no longer compact, and a typing error is more likely.
MOST_MODES: Final = 2000

USUAL_MODES: Final = 7
"""Default number of modes: a whole set for every topology."""


class ErrorKind(StrEnum):
    """Error that a tolerance limits, over all frames: docs/error.md."""

    RMS = "rms"
    WEIGHTED_RMS = "weighted_rms"
    MAX = "max"


class SignatureKind(StrEnum):
    """What amplitudes are of: displacements of points, or of the surface along its normals.

    Normal displacements are distances along the reference's normals; they see no motion within the
    surface.
    """

    MATERIAL = "material"
    NORMAL_DISPLACEMENT = "normal_displacement"


@shown(
    *("modes", "tolerance", "tolerance_of", "auto", "topology", "reference", "components", "kind"),
    "key",
)
@dataclass(frozen=True)
class SignatureParameters:
    """Request for a signature.

    The number of modes is set by one of `modes` (or `amplitudes`), `tolerance` and `auto`; it is
    7 if none is given.

    Parameters
    ----------
    modes : int or None
        Number of modes, three amplitudes per frame each, or one of normal displacements. 7 where
        nothing else is asked for; rounded up where a cosine-sine pair would be split. None where it
        follows from the data.
    topology : str or None
        Topology: cup, cylinder, ..., or mesh for the spring modes of the mesh itself. It takes
        precedence over that of the sequence.
    reference : int or "mean"
        Frame from which displacements are measured, or mean: the mean shape of all frames. Each is
        turned onto it, and turned as they are on the mean: another first frame then changes
        nothing, unless the frames turn all the way round.
    remove_rotation : bool
        Whether each frame's rotation is taken out before the fit.
    components : Components
        Directions of the three amplitudes of a mode: x, y, z or radial, tangential, axial.
    landmarks : GivenLandmarks
        Places stated by the user, over those of the shape.
    template : str or None
        Id of a template to use in place of one made from the sequence's own reference.
    tolerance : float or None, mm
        Largest error allowed: the fewest modes within it are taken.
    tolerance_of : ErrorKind
        Error that a tolerance limits: the RMS over all frames and vertices, the same
        weighted by area, or the largest of any vertex.
    auto : bool
        Stop where the residual looks like the noise of the measurement.
    harmonics : int or None
        Harmonics that each amplitude's path over time is limited to. None leaves it as it is.
    kind : SignatureKind
        Whether amplitudes follow the vertices, or measure the surface along its reference's
        normals. NORMAL_DISPLACEMENT has one amplitude a mode, and does not see where on the surface
        the vertices are: see `modalmotion.signature.normal_displacements`.
    volumes : bool
        Whether the signature has the volume that the surface encloses in each frame. Models may
        read it.
    deviations : bool
        Whether the signature has a standard deviation of each amplitude, from estimated noise.
        Of a tracked sequence, and with `auto`, it has in any case.
    amplitudes : int, optional
        In place of `modes`: amplitudes per frame, three of a mode, or one of normal displacements.
    """

    modes: int | None = None
    topology: str | None = None
    reference: sequence.Reference = 0
    remove_rotation: bool = True
    components: body_frame.Components = body_frame.Components.CARTESIAN
    landmarks: GivenLandmarks = field(default_factory=GivenLandmarks)
    template: str | None = None
    tolerance: float | None = None
    tolerance_of: ErrorKind = ErrorKind.RMS
    auto: bool = False
    harmonics: int | None = None
    kind: SignatureKind = SignatureKind.MATERIAL
    volumes: bool = False
    deviations: bool = False
    amplitudes: InitVar[int | None] = None

    def __post_init__(self, amplitudes: int | None) -> None:
        if amplitudes is not None:
            if self.modes is not None:
                raise _several_requests(["modes", "amplitudes"])
            n_directions = 1 if self.kind == SignatureKind.NORMAL_DISPLACEMENT else 3
            n_modes = -(-whole("amplitudes", amplitudes) // n_directions)
            object.__setattr__(self, "modes", n_modes)
        self._take_kinds()
        values = {name: getattr(self, name) for name in _WAYS}
        requests = [name for name, value in values.items() if not (value is None or value is False)]
        if len(requests) > 1:
            raise _several_requests(requests)
        if not requests:
            object.__setattr__(self, "modes", USUAL_MODES)
        if self.modes is not None and not 1 <= self.modes <= MOST_MODES:
            raise errors.ModeCountError(
                f"{self.modes} modes were requested; a signature has 1 to {MOST_MODES}.",
                remedy=f"Ask for 1 to {MOST_MODES} modes; 7 is the usual number.",
                details={"modes": self.modes, "most": MOST_MODES},
            )
        self._require_kind()
        if self.tolerance is not None and not (np.isfinite(self.tolerance) and self.tolerance >= 0):
            raise errors.ParameterError(
                f"The tolerance is {self.tolerance}.", remedy="Use a finite number, 0 or more."
            )
        if self.harmonics is not None and self.harmonics < 0:
            raise errors.ParameterError(
                f"{self.harmonics} harmonics were requested.", remedy="Use 0 or more."
            )

    def _require_kind(self) -> None:
        """Refuse for normal displacements what only displacements have."""
        if self.kind == SignatureKind.MATERIAL:
            return
        if self.components != body_frame.Components.CARTESIAN:
            raise errors.ParameterError(
                f"A normal displacement has one number per mode and no {self.components} "
                "components.",
                remedy="Omit components, or use kind=material.",
            )
        if self.auto:
            raise errors.ParameterError(
                "The noise of the vertices, which auto needs, is not known for normal "
                "displacements.",
                remedy="Use modes or tolerance, or kind=material.",
            )

    def _take_kinds(self) -> None:
        """Take each value as what it should be, or refuse it by name."""
        takes: dict[str, Callable[[str, Any], object]] = {
            **dict.fromkeys(("modes", "harmonics"), whole),
            "tolerance": real,
            **dict.fromkeys(("remove_rotation", "auto", "volumes", "deviations"), truth),
            "components": partial(one_of, words=body_frame.Components),
            "tolerance_of": partial(one_of, words=ErrorKind),
            "kind": partial(one_of, words=SignatureKind),
            **dict.fromkeys(("topology", "template"), _name),
        }
        if self.reference != sequence.MEAN:
            takes["reference"] = whole
        if not isinstance(self.landmarks, GivenLandmarks):
            raise errors.ParameterError(
                f"landmarks is {repr(self.landmarks)[:80]}, not places with names.",
                remedy="Give them as GivenLandmarks(apex=..., base=...).",
            )
        for name, take in takes.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, take(name, value))

    @property
    def n_directions(self) -> int:
        """Number of amplitudes of a mode in each frame."""
        return 1 if self.kind == SignatureKind.NORMAL_DISPLACEMENT else 3

    @property
    def closed_form(self) -> bool:
        """Whether the modes may be those of a topology, and not the springs' of the mesh."""
        return self.topology != MESH

    @property
    def fixes_kind(self) -> bool:
        """Whether the kind of modes is stated, and not left to the shape of each recording."""
        return self.topology is not None or self.template is not None

    def with_facts(
        self, facts: mesh.Facts, topology: Topology | str | None, grid: tuple[int, ...] | None
    ) -> "SignatureParameters":
        """Return the parameters with the facts that the fit reads: landmarks of the template.

        So the key contains a fact that the fit reads, and no other.

        Parameters
        ----------
        facts : Facts
            Of the sequence; landmarks that the parameters state go over its own.
        topology : Topology, str or None
            As the sequence states it.
        grid : tuple of int or None
            Of the sequence.
        """
        if self.template is not None or not self.closed_form or not facts.landmarks:
            return self
        known = topology if self.topology is None else self.topology
        landmarks = landmarks_in(
            facts,
            self.landmarks,
            Topology.parse(known) if isinstance(known, str) else known,
            is_lattice=grid is not None,
        )
        # `amplitudes` is not a field: replacing leaves `modes` as it is.
        return self if landmarks == self.landmarks else replace(self, landmarks=landmarks)

    @cached_property
    def key(self) -> str:
        """Short name of this choice of parameters, for file names and ETags."""
        text = json.dumps(parameters_as_json(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _name(name: str, value: Any) -> str:
    if not isinstance(value, str | Topology):
        raise errors.ParameterError(
            f"{name} is {repr(value)[:80]}, not a name.",
            remedy=f"Give its name or id as text: {name}='...'.",
        )
    return str(value)


_WAYS: Final = ("modes", "tolerance", "auto")


def _several_requests(names: list[str]) -> errors.ParameterError:
    return errors.ParameterError(
        f"The number of modes was set in several ways: {', '.join(names)}.",
        remedy="Set one of modes, amplitudes, tolerance and auto.",
        details={"asked": names},
    )


_NAMES: Final = tuple(field.name for field in fields(SignatureParameters))


def parameters_as_json(parameters: SignatureParameters) -> dict[str, Any]:
    """Values of a signature's parameters, ready for JSON."""
    # All are plain values; `asdict` would copy them.
    values = {name: getattr(parameters, name) for name in _NAMES}
    return {**values, "landmarks": parameters.landmarks.as_json()}


def parameters_from_json(values: dict[str, Any]) -> SignatureParameters:
    """Read the output of `parameters_as_json`."""
    landmarks = GivenLandmarks.from_json(values["landmarks"])
    own = {name: values[name] for name in _NAMES}
    return SignatureParameters(**{**own, "landmarks": landmarks})


# Times are of the processor, for an honest file of that size, on the dear side of what was
# measured: docs/decisions/0021-fair-and-bounded-work.md.

# s for any task, and s for a byte of input: an array is read and laid out, a text is parsed too.
_START: Final = 0.02
_OF_ARRAYS: Final = 5e-8
_OF_TEXTS: Final = 1e-6

# Files that hold arrays as they are, or compressed.
_ARRAYS: Final = (Format.NPZ, Format.HDF5, Format.GLB, Format.RAW, None)

# Factoring m shapes takes m^2 products at each vertex, and a vertex is some 100 bytes of a file
# with some frames. A row of m numbers a vertex costs as much as m + 100 products.
_BYTES_OF_VERTEX: Final = 100
_OF_PRODUCT: Final = 4e-10
_OVERHEAD: Final = 100

# The same where the modes must be solved for: 300 of 1,000, 4,000 and 16,000 vertices took 0.7,
# 3.6 and 18 s, and 300 of 1,820 in many parts 3.7 s.
_OF_SPRING_PRODUCT: Final = 1.5e-8

# Modes that are looked at where their number follows from the data, and how often they are fitted.
_LOOKED_AT: Final = 300
_FITS: Final = 3
_FITS_OF_MAX: Final = 20

# s for a byte, where the noise of the motion is estimated.
_OF_NOISE: Final = 1e-5


def reading_seconds(n_bytes: int, kind: Format | None = None) -> float:
    """Predict the processor time that reading a file and laying coordinates over it takes, in s.

    Parameters
    ----------
    n_bytes : int
    kind : Format, optional
        One that holds arrays by default.
    """
    return _START + n_bytes * (_OF_ARRAYS if kind in _ARRAYS else _OF_TEXTS)


def signature_seconds(
    n_bytes: int, parameters: SignatureParameters, kind: Format | None = None
) -> float:
    """Predict the processor time of a signature, parsing counted, in s.

    Parameters
    ----------
    n_bytes : int
        Of the file that the sequence is in.
    parameters : SignatureParameters
    kind : Format, optional
        Of the file; one that holds arrays by default.
    """
    modes, fits = most_modes(parameters), 1
    if modes != parameters.modes:
        fits = _FITS_OF_MAX if parameters.tolerance_of == ErrorKind.MAX else _FITS
    is_estimated = parameters.auto or parameters.deviations
    noise = _OF_NOISE * n_bytes if is_estimated else 0.0
    springs = 0.0 if parameters.closed_form else spring_seconds(n_bytes, modes)
    fitting = fits * _products(n_bytes, modes) * _OF_PRODUCT
    return reading_seconds(n_bytes, kind) + fitting + noise + springs


def spring_seconds(n_bytes: int, modes: int) -> float:
    """Predict the processor time that solving for the spring modes of a mesh takes, in s.

    A signature takes it where the surface turns out to have no natural coordinates, which is
    known only when its file has been read.

    Parameters
    ----------
    n_bytes : int
        Of the file that the sequence is in.
    modes : int
    """
    return _products(n_bytes, modes) * _OF_SPRING_PRODUCT


def most_modes(parameters: SignatureParameters) -> int:
    """Give the largest number of modes that a request makes necessary to look at."""
    return _LOOKED_AT if parameters.modes is None else parameters.modes


def _products(n_bytes: int, modes: int) -> int:
    n_vertices = max(1, n_bytes // _BYTES_OF_VERTEX)
    # No more modes than vertices.
    modes = min(modes, n_vertices)
    return n_vertices * modes * (modes + _OVERHEAD)
