"""Making templates: normalise the reference, recognise it, find its natural coordinates."""

from dataclasses import replace

import numpy as np

from modalmotion import errors
from modalmotion.mesh import alignment, triangles
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.modes.topologies import CYLINDER, SPHERE, Topology, lattice_coordinates
from modalmotion.notes import Note
from modalmotion.numeric.scales import power_of_two
from modalmotion.progress import Progress, Reporter, part_of, silent
from modalmotion.representation import Floats, Ints, counted
from modalmotion.template import axial_coordinates, axis, other_coordinates, surfaces, template
from modalmotion.template.landmarks import (
    LANDMARKS_ON,
    Coordinates,
    GivenLandmarks,
    Landmarks,
    lattice_landmarks,
    require_used,
    resolve_places,
)


def shares_of(
    surface: surfaces.Surface,
    sequence: MeshSequence,
    topology: Topology | None,
    notes: list[Note],
    first: Ints,
) -> Floats:
    """Shares of vertices in rotation, fit and error, (vertices,) float64; they add up to 1.

    Parameters
    ----------
    surface : Surface
    sequence : MeshSequence
    topology : Topology or None
    notes : list of Note
        Told where there are no areas to weigh by.
    first : (vertices,) int64
        The vertex that stands for each.
    """
    areas, unknown = surface.areas, "area_zero" if len(surface.faces) else "areas_unknown"
    if topology is not None and topology.n_axes == 1:
        areas, unknown = triangles.curve_weights(surface.vertices, topology), "area_zero"
    total = float(areas.sum())
    if not total > 0:
        notes.append(Note.of(unknown))
        return np.full(sequence.n_vertices, 1.0 / sequence.n_vertices)
    # What stands for others has their weight too.
    weightless = int((areas[first] == 0).sum())
    if weightless:
        notes.append(Note.of("vertices_without_weight", n_vertices=weightless))
    return np.asarray(areas / total)


# Below this degree too many places share the same natural coordinates.
_FOLDED = 0.8

# So near to it noise, or another recording of the same, may fall on the other side.
_BORDER = 0.1

# Of the time on a large mesh, until it is measured, recognised, and has its coordinates.
_MEASURED, _RECOGNISED, _SOLVED = 0.25, 0.3, 0.8

_MAKERS = axial_coordinates.AXIAL | other_coordinates.OTHERS


def make_template(
    sequence: MeshSequence,
    *,
    reference: Reference = 0,
    landmarks: GivenLandmarks | None = None,
    closed_form: bool = True,
    by_rows: bool = True,
    report: Reporter = silent,
) -> template.Template:
    """Make the template of a sequence from one of its own frames.

    Parameters
    ----------
    sequence : MeshSequence
        A stated topology is accepted where the connectivity allows it; without one the
        connectivity decides.
    reference : int or "mean"
        Frame whose shape the coordinates and areas are taken from.
    landmarks : GivenLandmarks, optional
        Places stated by the user, over those of the shape and of the sequence's facts.
    closed_form : bool
        False selects the spring modes of the mesh, even on a known topology.
    by_rows : bool
        Whether the rows and columns of a lattice are its coordinates; False takes those of the
        surface between its nodes, where it has an axis.
    report : callable, optional
        Told the share that is done: a million vertices take seconds.

    Raises
    ------
    ParameterError
        If there is no such frame, or a landmark is not a place on the surface.
    TopologyError
        If the stated topology does not fit the connectivity, or there are neither triangles
        nor a stated topology.
    """
    sequence.require_reference(reference)
    is_stated = sequence.topology is not None or sequence.grid is not None
    if reference == MEAN and not is_stated and closed_form:
        return _recognised_in_frame_0(sequence, landmarks, report)
    own_landmarks = template.landmarks_read(sequence, landmarks, closed_form=closed_form)
    start = alignment.reference_positions(sequence, reference)
    middle = alignment.middle_positions(sequence, reference)
    faces = sequence.joined
    first = sequence.representatives
    notes = _notes_on_merging(first)
    if notes:
        faces = first[faces]
        _require_left(faces)
    steady = surfaces.steady_shape(start, middle, faces, sequence.topology)[first]
    surface, corner, scale = _normalised(steady, faces)
    report(Progress(_MEASURED))
    mean = _mean_surface(surface, (middle[first] - corner) / scale)
    places, mean_places = (
        {name: (at - corner) / scale for name, at in resolve_places(own_landmarks, x).items()}
        for x in (steady, mean.vertices * scale + corner)
    )
    at_vertices = {
        name: int(first[place])
        for name in own_landmarks.names
        if isinstance(place := getattr(own_landmarks, name), int | np.integer)
    }
    isolated = np.zeros(0, dtype=np.int64)
    if len(faces):
        isolated = np.flatnonzero(np.isin(first, surface.isolated))
    if len(sequence.faces):
        notes += _notes_on_mesh(surface, isolated)
    topology, reason = _decide(sequence, surface, closed_form, notes)
    coordinates = placement = None
    report(Progress(_RECOGNISED))
    if topology is not None:
        of_surface = not by_rows and template.is_placed_by_shape(sequence)
        solving = part_of(report, _RECOGNISED, _SOLVED)
        if sequence.grid is not None:
            coordinates, places = _of_lattice(sequence.grid, topology, mean, of_surface=of_surface)
            mean_places = places
        if coordinates is None and topology.n_axes == 1:
            coordinates = other_coordinates.curve_coordinates(surface.vertices, topology, places)
        elif coordinates is None:
            axes_of, make = _MAKERS[topology]
            placement = axis.Placement(
                topology, surface, mean, places, mean_places, at_vertices, scale, axes_of, make
            )
            coordinates = make(surface, places, placement.axes, solving)
    report(Progress(_SOLVED))
    if coordinates is not None and topology in _MAKERS and not sequence.grid:
        cover = axis.degree(surface, coordinates.values, coordinates.topology)
        is_choice = topology == SPHERE and sequence.topology is None
        if is_choice and abs(cover - _FOLDED) < _BORDER:
            notes.append(Note.of("kind_near_border", cover=cover, border=_FOLDED))
        if cover < _FOLDED and is_choice:
            coordinates = None
        elif cover < _FOLDED:
            wanted = _places_wanted(coordinates.topology)
            notes.append(Note.of("coordinates_fold", cover=cover, landmarks=wanted))
    if topology is not None and coordinates is None:
        topology, reason = None, f"The surface is a {topology}, but not around a straight axis."
    require_used(own_landmarks, topology, is_lattice=sequence.grid is not None)
    if reason and topology is None:
        notes.append(Note.of("spring_modes_used", reason=reason))
    shares = shares_of(surface, sequence, topology, notes, first)
    id_ = template.template_id(
        sequence,
        reference=reference,
        landmarks=own_landmarks,
        closed_form=closed_form,
        by_rows=by_rows,
    )
    values = np.zeros((len(start), 0))
    lengths: tuple[float, ...] = ()
    placed: Landmarks | None = None
    if coordinates is not None:
        values = template.carried_over(coordinates.values[first], start, isolated)
        lengths = surfaces.axis_lengths(surface, coordinates.topology, sequence.grid, values)
        notes += coordinates.notes
        if coordinates.landmarks is not None:
            placed = coordinates.landmarks.placed(corner, scale)
            notes += _notes_on_landmarks(coordinates.landmarks, coordinates.topology)
    return template.Template(
        id=id_,
        surface=topology,
        coordinates=values,
        weights=shares,
        lengths=tuple(length * scale for length in lengths),
        landmarks=placed,
        vertices=start,
        faces=faces,
        representatives=first,
        isolated=isolated,
        placement=placement,
        reason="" if topology is not None else reason,
        notes=tuple(notes),
    )


def _recognised_in_frame_0(
    sequence: MeshSequence,
    landmarks: GivenLandmarks | None,
    report: Reporter,
) -> template.Template:
    """Make the template of the mean shape, with the topology of frame 0.

    Limbs that swing leave a mean without them, which may be a sphere although no frame is one.
    """
    first = make_template(sequence, landmarks=landmarks, report=part_of(report, 0.0, 0.5))
    is_known = first.surface is not None
    of_mean = make_template(
        sequence.with_topology(first.surface, None),
        reference=MEAN,
        closed_form=is_known,
        landmarks=landmarks,
        report=part_of(report, 0.5, 1.0),
    )
    id_ = template.template_id(sequence, reference=MEAN, landmarks=landmarks)
    notes = tuple(dict.fromkeys((*first.notes, *of_mean.notes))) if is_known else first.notes
    return replace(of_mean, id=id_, reason=first.reason, notes=notes)


def _decide(
    sequence: MeshSequence, surface: surfaces.Surface, closed_form: bool, notes: list[Note]
) -> tuple[Topology | None, str]:
    """Topology whose modes to use, or None and why."""
    stated = sequence.topology
    if not closed_form:
        if not len(surface.faces):
            raise errors.TopologyError(
                "Spring modes were requested, but no edges join the vertices.",
                remedy="Send triangles, or a lattice of two axes.",
            )
        return None, "Spring modes were requested."
    if sequence.grid is not None and stated is None:
        raise errors.TopologyError(
            f"The lattice of {sequence.grid} nodes has no topology.",
            remedy="Set which ends are joined: topology = cup, cylinder, plane, torus, "
            "sphere, open curve or closed curve.",
        )
    if stated is not None:
        if sequence.grid is None and stated.n_axes != 1:
            surfaces.require_fit(surface, stated)
        return stated, ""
    if not len(surface.faces):
        raise errors.TopologyError(
            f"{sequence.n_vertices} points were sent without faces, grid or topology.",
            remedy="Send triangles, or the lattice as grid and topology, or set the topology to "
            "open curve or closed curve.",
        )
    topology, reason = surfaces.recognise(surface)
    if topology is not None and reason:
        notes.append(Note.of("topology_doubtful", reason=reason))
    return topology, reason


def _of_lattice(
    grid: tuple[int, ...], topology: Topology, mean: surfaces.Surface, *, of_surface: bool
) -> tuple[Coordinates | None, dict[str, Floats]]:
    """Coordinates by rows and columns; or where those of the surface, if wanted, begin."""
    values = lattice_coordinates(topology, grid)
    landmarks = lattice_landmarks(mean, topology, values)
    if not of_surface or landmarks is None:
        return Coordinates(topology, values, landmarks), {}
    # The lattice still says where theta is 0 and, of a cylinder, which end is which.
    places = {"theta_zero": landmarks.origin + landmarks.theta_zero * np.sqrt(mean.area)}
    if topology == CYLINDER:
        places["base"] = landmarks.base
    return None, places


def _require_left(faces: Ints) -> None:
    """Refuse a surface of which merging leaves no triangle."""
    a, b, c = faces.T
    if ((a == b) | (b == c) | (c == a)).all():
        raise errors.TopologyError(
            f"All {len(faces)} triangles have two corners at the same place in every frame, so "
            "there is no surface.",
            remedy="Send a surface with an area: vertices that coincide in every frame are merged.",
        )


def _normalised(start: Floats, faces: Ints) -> tuple[surfaces.Surface, Floats, float]:
    """Bring the surface near the origin and near size 1: position = scale * result + corner.

    Vertices in no triangle may lie anywhere and must not set the scale: they are put into
    the corner.
    """
    used = np.full(len(start), not len(faces))
    used[faces.ravel()] = True
    corner = start[np.argmax(used)]
    vertices = np.where(used[:, None], start, corner) - corner
    largest = float(np.abs(vertices).max(initial=0.0))
    scale = power_of_two(largest)
    surface = surfaces.surface_of(vertices / scale, faces)
    return surface, corner, scale


def _mean_surface(surface: surfaces.Surface, middle: Floats) -> surfaces.Surface:
    """Move the triangles to the mean of all frames, its area centroid to the reference's."""
    middle = middle.copy()
    middle[surface.isolated] = surface.vertices[surface.isolated]
    mean = surface.moved_to(middle)
    if not (mean.area > 0 and surface.area > 0) or np.array_equal(mean.vertices, surface.vertices):
        return surface
    return replace(mean, vertices=mean.vertices + (surface.centroid - mean.centroid))


def _notes_on_merging(representatives: Ints) -> list[Note]:
    """Note how many vertices were merged with others: see `Template.representatives`."""
    others = np.flatnonzero(representatives != np.arange(len(representatives)))
    if not len(others):
        return []
    note = Note.of(
        "vertices_merged",
        vertices=counted(len(others), "vertex", "vertices"),
        n_all=len(representatives),
        first=others[0],
        other=representatives[others[0]],
    )
    return [note]


def _notes_on_mesh(surface: surfaces.Surface, isolated: Ints) -> list[Note]:
    """Name the parts of a mesh outside its surface.

    Parameters
    ----------
    surface : Surface
    isolated : (n,) int64
        Vertices in no triangle.
    """
    degenerate, repeated = surface.connectivity.degenerate, surface.connectivity.repeated
    notes = []
    if len(isolated):
        notes.append(Note.of("vertices_isolated", n_vertices=len(isolated), first=isolated[0]))
    if len(degenerate):
        notes.append(
            Note.of("triangles_degenerate", n_triangles=len(degenerate), first=degenerate[0])
        )
    if len(repeated):
        notes.append(
            Note.of(
                "triangles_repeated",
                triangles=counted(len(repeated), "triangle"),
                first=repeated[0],
            )
        )
    return notes


def _notes_on_landmarks(landmarks: Landmarks, topology: Topology) -> list[Note]:
    """Name the landmarks that the shape does not determine."""
    meaning = {
        "axis": "The direction of the axis",
        "apex": "Which end is the apex",
        "base": "Which end is the base",
        "theta_zero": "The zero of theta",
        "start": "Which corner s and t start from",
    }
    weak = [name for name in meaning if name in landmarks.weak]
    has_pairs = "theta_zero" in weak and topology.closed_axes
    pairs = " The cosine and the sine of a pair can only be compared together."
    return [
        Note.of(
            "landmark_undetermined",
            what=meaning[name],
            landmarks=_places_wanted(topology, name),
            pairs=pairs if has_pairs and name == weak[-1] else "",
        )
        for name in weak
    ]


def _places_wanted(topology: Topology, weak: str = "axis") -> str:
    """Name the landmarks that determine a weak one, and the option that states them."""
    used = LANDMARKS_ON.get(topology.name, ())
    wanted = [weak] if weak in used else [name for name in used if name != "theta_zero"]
    if weak == "axis":
        wanted = [name for name in used if name in ("apex", "base")]
    names = " and ".join(wanted)
    kind = "landmark" if len(wanted) == 1 else "landmarks"
    return f"the {kind} {names} (--landmark {wanted[0]}=PLACE)" if wanted else "another topology"
