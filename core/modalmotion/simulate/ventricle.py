"""A simulated left ventricle over one heartbeat, and the motion of its material points.

A prescribed motion, not mechanics: every wall element contracts towards the axis and along
the wall by its own share of its own time course, and each level turns about the axis. All
fields are smooth functions of the direction from the spheroid's middle, so the motion has no
kink at the apex.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.arguments.checking import real, whole, whole_numbers
from modalmotion.mesh import sequence
from modalmotion.modes.topologies import CUP
from modalmotion.representation import Floats, shown
from modalmotion.simulate import surface
from modalmotion.simulate.parameters import SmoothField, VentricleParameters, random_field

# The fibrous ring at the base contracts half as much as the wall below it.
_BASE_RESTRAINT: Final = 0.5

# Width of a region's border, in the cosine of the angle from its centre.
_BORDER: Final = 0.12

# An akinetic wall keeps half of its shortening along the axis: its neighbours and the ring at
# the base pull it along.
_TETHERING: Final = 0.5

# Lateness of an individual's walls that move out of step, s.
_LAG: Final = 0.08

# Points along each meridian at which the wall's shortening is added up from the apex.
_QUADRATURE: Final = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True, eq=False)
class Moment:
    """One time of the beat, except for the radial contraction.

    Parameters
    ----------
    radii : (points,) float64, mm
        Of the resting wall.
    restraint : (points,) float64
        Share of the radial contraction that the fibrous ring permits.
    contraction : (points,) float64
    across : two of (points,) float64
        Cosine and sine of the azimuths.
    heights : (points,) float64, mm
    individual : (points, 3) float64, mm
        Added to the displacement.
    """

    radii: Floats
    restraint: Floats
    contraction: Floats
    across: tuple[Floats, Floats]
    heights: Floats
    individual: Floats

    def positions(self, radial: float) -> Floats:
        """Positions in the body frame: origin at the resting apex, z from apex to base.

        Parameters
        ----------
        radial : float
            Radial contraction of a wall that contracts fully, as a share of its radius.

        Returns
        -------
        (points, 3) float64, mm
        """
        r = self.radii * (1.0 - radial * self.restraint * self.contraction)
        x = np.stack([r * self.across[0], r * self.across[1], self.heights], axis=1)
        x += self.individual
        return x


@dataclass(frozen=True, eq=False)
class MaterialPoints:
    """Material points of one ventricle and their motion.

    Parameters
    ----------
    parameters : VentricleParameters
    polar_angles, azimuths : (points,) float64, rad
    shape, displacement, lag : SmoothField
        Individual variation: added to the surface, to the displacement as it contracts, and to
        the displacement that runs ahead of or behind the contraction.
    """

    parameters: VentricleParameters
    polar_angles: Floats
    azimuths: Floats
    shape: SmoothField
    displacement: SmoothField
    lag: SmoothField

    def positions(self, time: float, radial: float) -> Floats:
        """Positions at a time, (points, 3) float64, mm: see `at` and `Moment.positions`."""
        return self.at(time).positions(radial)

    def at(self, time: float) -> Moment:
        """Everything at a time that does not depend on the radial contraction.

        Parameters
        ----------
        time : float, s
            Since end diastole, 0 to one period.
        """
        p, beat = self.parameters, self.parameters.beat
        nu, theta, s = self.polar_angles, self.azimuths, self.spheroid
        q, q_below = self._contraction(time)
        # z(nu) = int_0^nu (1 - e q) dz/dnu dnu along the meridian, by Gauss's rule
        shortened = 1.0 - p.longitudinal_shortening * q_below
        z = (shortened * self._height_steps).sum(axis=0)
        rise = p.apex_share * p.longitudinal_shortening * p.length
        # Seen from the apex counterclockwise is clockwise about the axis: hence the minus.
        level = s.height_at(nu) / p.length
        turn = -np.radians(p.apex_rotation - level * p.twist) * beat.twist(time)
        in_time, late = beat.contraction(time, p.delay / 2 + np.array([0.0, _LAG]))
        shape, displacement, lag = self._individual
        return Moment(
            radii=s.radius_at(nu),
            restraint=self._restraint,
            contraction=q,
            across=(np.cos(theta + turn), np.sin(theta + turn)),
            heights=z + rise * beat.contraction(time, np.zeros(1)),
            individual=shape + in_time * displacement + (late - in_time) * lag,
        )

    @cached_property
    def spheroid(self) -> surface.Spheroid:
        """The resting shape without individual variation."""
        p = self.parameters
        return surface.Spheroid(p.length, p.radius, float(np.radians(p.truncation)))

    @cached_property
    def _individual(self) -> tuple[Floats, ...]:
        n = surface.directions(self.polar_angles, self.azimuths)
        return self.shape.at(n), self.displacement.at(n), self.lag.at(n)

    @cached_property
    def _restraint(self) -> Floats:
        level = self.spheroid.height_at(self.polar_angles) / self.parameters.length
        restraint: Floats = 1.0 - _BASE_RESTRAINT * level**4
        return restraint

    @cached_property
    def _height_steps(self) -> Floats:
        """Height of the resting wall in each part of the quadrature, (nodes, points), mm."""
        share, weight = (_QUADRATURE[0] + 1) / 2, _QUADRATURE[1] / 2
        steps: Floats = (
            weight[:, None]
            * self.polar_angles
            * self.spheroid.slope_at(share[:, None] * self.polar_angles)
        )
        return steps

    @cached_property
    def _regions(self) -> tuple[Floats, Floats, Floats]:
        """Working share, lateness and earliness of the points (row 0) and of those below them."""
        share = np.concatenate([[1.0], (_QUADRATURE[0] + 1) / 2])
        n = surface.directions(share[:, None] * self.polar_angles, self.azimuths)
        p = self.parameters
        # The wall between the late (1) and the early side (0), and how septal it is.
        late = (1.0 + n[..., :2] @ _across(p.delay_azimuth)) / 2
        lost = p.akinesia * region_weight(p, n)
        lost[1:] *= 1.0 - _TETHERING
        return 1.0 - lost, late, (1.0 - late) ** 2

    def _contraction(self, time: float) -> tuple[Floats, Floats]:
        """Contraction at the points, and at the quadrature's nodes below each of them."""
        p, beat = self.parameters, self.parameters.beat
        working, late, early = self._regions
        flash = p.septal_flash * early
        q = beat.contraction(time, p.delay * late)
        q = working * ((1.0 - flash) * q + flash * beat.flash(time))
        return q[0], q[1:]


def region_weight(parameters: VentricleParameters, n: Floats) -> Floats:
    """Membership of a wall element in the akinetic region, 1 at its centre.

    Parameters
    ----------
    parameters : VentricleParameters
    n : (..., 3) float64
        Directions of the elements.

    Returns
    -------
    (...) float64
    """
    p = parameters
    x, y = np.sin(_polar_angle(p)) * _across(p.akinesia_azimuth)
    centre = np.array([x, y, -np.cos(_polar_angle(p))])
    edge = np.cos(np.radians(p.akinesia_extent))
    inside = 1.0 / (1.0 + np.exp(-(n @ centre - edge) / _BORDER))
    weight: Floats = inside * (1.0 + np.exp(-(1.0 - edge) / _BORDER))
    return weight


def _polar_angle(parameters: VentricleParameters) -> float:
    x = parameters.akinesia_height * np.sin(np.radians(parameters.truncation) / 2) ** 2
    return float(2.0 * np.arcsin(np.sqrt(x)))


def _across(azimuth: float) -> Floats:
    angle = np.radians(azimuth)
    return np.array([np.cos(angle), np.sin(angle)])


# Correlation lengths of individual variation. With _FINE and 2 mm, 7, 18 and 37 modes leave
# 1.1, 0.7 and 0.4 mm, as on a real ventricle; lateness differs wall by wall.
_FINE: Final = 0.4
_COARSE: Final = 0.8

# Range of radial contractions in which the ejection fraction is sought.
_LEAST_RADIAL, _MOST_RADIAL = -0.15, 0.9

# Lattice on which the time of the smallest volume is sought first.
_SEARCH_GRID: Final = (12, 24)
_N_SEARCH_TIMES: Final = 15

# Share of the volume: less does not count as ejection.
_SMALLEST_EJECTION: Final = 1e-3


@shown()
@dataclass(frozen=True)
class Acquisition:
    """Settings of a ventricle's recording.

    Parameters
    ----------
    n_frames : int
        Spread evenly over one beat; the frame after the last would repeat the first.
    start_phase : float
        Phase of frame 0, in beats; 0 is end diastole.
    is_closed : bool
        Whether the last frame repeats the first, one beat later.
    noise : float, mm
        Standard deviation of each coordinate of each vertex in each frame.
    pose : Pose
        Position and drift of the ventricle.
    """

    n_frames: int = 25
    start_phase: float = 0.0
    is_closed: bool = False
    noise: float = 0.0
    pose: surface.Pose = field(default_factory=surface.Pose)

    def __post_init__(self) -> None:
        whole("n_frames", self.n_frames)
        for name in ("start_phase", "noise"):
            real(name, getattr(self, name))
        if not 1 <= self.n_frames <= 10_000:
            raise errors.ParameterError(
                f"{self.n_frames} frames were requested.", remedy="Use 1 to 10,000 frames."
            )
        if not (np.isfinite(self.start_phase) and 0.0 <= self.noise < np.inf):
            raise errors.ParameterError(
                f"The start phase is {self.start_phase} and the noise {self.noise} mm.",
                remedy="Use a finite phase and a finite noise, 0 or more.",
            )


def simulate_ventricle(
    parameters: VentricleParameters | None = None,
    *,
    grid: tuple[int, int] = (32, 64),
    n_vertices: int | None = None,
    spacing: surface.Spacing = surface.Spacing.ARC,
    acquisition: Acquisition | None = None,
    rng: "np.random.Generator | None" = None,
) -> sequence.MeshSequence:
    """Simulate one heartbeat of a left ventricle's inner surface.

    Parameters
    ----------
    parameters : VentricleParameters, optional
        A healthy adult's by default.
    grid : (int, int)
        Rows and columns of a cup lattice, row 0 next to the apex, columns right-handed about
        the axis from apex to base, column 0 in the lateral wall.
    n_vertices : int, optional
        For an irregular triangulation of that many vertices in place of the lattice.
    spacing : Spacing
        Quantity that is equal between the lattice's rows.
    acquisition : Acquisition, optional
        25 frames from end diastole on, without noise, by default.
    rng : numpy.random.Generator, optional
        Needed where something is random: variation, triangulation, noise. The individual is drawn
        first, so the same generator state gives the same one on any mesh.

    Returns
    -------
    MeshSequence
        mm and s, topology cup, with its facts.

    Raises
    ------
    ParameterError
        If the ejection fraction cannot be reached with this shortening, or a generator is
        missing.
    ShapeError
        If the grid is not that of a cup.

    Notes
    -----
    The radial contraction is solved so that 1 - (smallest volume) / (volume at end diastole)
    of the mesh itself, its openings closed by flat fans, is the ejection fraction. Before
    noise; the smallest volume is that of the continuous motion, which frames may miss.
    """
    p = VentricleParameters() if parameters is None else parameters
    recorded = Acquisition() if acquisition is None else acquisition
    grid = whole_numbers("grid", grid)  # type: ignore[assignment]
    if n_vertices is not None:
        n_vertices = whole("n_vertices", n_vertices)
    is_random = n_vertices is not None or recorded.noise > 0
    if rng is None:
        if is_random or p.shape_variation > 0 or p.motion_variation > 0:
            raise errors.ParameterError(
                "Variation, noise and triangulation are random, but no generator came.",
                remedy="Give rng=numpy.random.default_rng(seed).",
            )
        rng = np.random.default_rng(0)  # drawn from, but only times zero
    # Drawn before the mesh, so that two meshes can share one individual.
    fields = (
        random_field(p.shape_variation, _FINE, rng),
        random_field(p.motion_variation, _FINE, rng),
        random_field(p.motion_variation, _COARSE, rng),
    )
    spheroid = surface.Spheroid(p.length, p.radius, float(np.radians(p.truncation)))
    if n_vertices is None:
        points = surface.lattice_points(spheroid, grid, spacing)
    else:
        points = surface.triangle_points(spheroid, n_vertices, rng)
    motion = MaterialPoints(p, points.polar_angles, points.azimuths, *fields)
    radial = _radial_contraction(motion, points)

    n_steps = recorded.n_frames - 1 if recorded.is_closed else recorded.n_frames
    beats = np.arange(recorded.n_frames) / max(n_steps, 1)
    phases = np.mod(beats + recorded.start_phase, 1.0)
    vertices = np.stack([motion.positions(phase * p.period, radial) for phase in phases])
    vertices = recorded.pose.place(vertices, beats, np.array([0.0, 0.0, p.length / 2]))
    if recorded.noise > 0:
        vertices += rng.normal(0.0, recorded.noise, vertices.shape)
    return sequence.mesh_sequence(
        vertices,
        points.faces,
        grid=points.grid,
        topology=CUP,
        times=beats * p.period,
        unit="mm",
        facts=mesh.Facts(
            tracking="material",
            handedness="right",
            period=p.period,
            cavity="lv",
            modality="simulated",
        ),
    )


def _radial_contraction(motion: MaterialPoints, points: surface.Points) -> float:
    """Radial contraction that gives the mesh its ejection fraction."""
    p, beat = motion.parameters, motion.parameters.beat
    coarse = surface.lattice_points(motion.spheroid, _SEARCH_GRID)
    search = replace(motion, polar_angles=coarse.polar_angles, azimuths=coarse.azimuths)
    cavity = mesh.Cavity(coarse.faces)
    time = (beat.end_systole + beat.relaxed) / 2
    times = np.linspace(0.6 * beat.end_systole, beat.relaxed + p.delay, _N_SEARCH_TIMES)
    step = times[1] - times[0]
    moments, full = [search.at(t) for t in times], search.at(0.0)
    # Where walls are late, the time of the smallest volume depends a little on the contraction.
    for _ in range(2):
        radial = _solve(p, cavity, full, search.at(time))
        volumes = [_volume(cavity, moment, radial) for moment in moments]
        if min(volumes) > (1.0 - _SMALLEST_EJECTION) * _volume(cavity, full, radial):
            break
        time = times[int(np.argmin(volumes))]
    cavity, full = mesh.Cavity(points.faces), motion.at(0.0)
    radial = _solve(p, cavity, full, motion.at(time))

    def volume(time: float) -> float:
        return _volume(cavity, motion.at(time), radial)

    # While the volume rests, untwisting changes that of a polyhedron in the sixth digit.
    time = min((time, beat.end_systole, beat.relaxed), key=volume)
    bounds = (time - step, time + step)
    time = scipy.optimize.minimize_scalar(
        volume, bounds=bounds, method="bounded", options={"xatol": 1e-5}
    ).x
    return _solve(p, cavity, full, motion.at(time))


def _volume(cavity: mesh.Cavity, moment: Moment, radial: float) -> float:
    return float(cavity.volume(moment.positions(radial)))


def _solve(p: VentricleParameters, cavity: mesh.Cavity, relaxed: Moment, moment: Moment) -> float:
    """Radial contraction with which the volume at `moment` is the end-systolic one."""
    full = cavity.volume(relaxed.positions(0.0))
    passive, pull = moment.positions(0.0), moment.positions(1.0)
    pull -= passive

    def excess(radial: float) -> float:
        volume = cavity.volume(passive + radial * pull)
        return float(volume / full - (1.0 - p.ejection_fraction))

    low, high = excess(_LEAST_RADIAL), excess(_MOST_RADIAL)
    if not low > 0 > high:
        raise errors.ParameterError(
            f"An ejection fraction of {p.ejection_fraction} cannot be reached with a "
            f"longitudinal shortening of {p.longitudinal_shortening}.",
            remedy="Bring the two nearer to each other, or make the akinetic region smaller.",
        )
    return float(scipy.optimize.brentq(excess, _LEAST_RADIAL, _MOST_RADIAL, xtol=1e-14))
