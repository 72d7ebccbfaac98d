"""Notes on a result: what its reader should know, each with a code and the numbers in it."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from modalmotion.representation import shown

WORDS: Final = {
    "polygons_split": (
        "Polygons of more than three corners ({n_polygons}) were split into triangles, each as a "
        "fan from its first corner."
    ),
    "polygons_dropped": "Polygons of fewer than three corners ({n_polygons}) were left out.",
    "stl_merged": (
        "STL contains no vertices: {n_corners} corners that coincide in frame 0 became "
        "{n_vertices} vertices in all frames."
    ),
    "frames_sorted": "The frames were sorted by their times.",
    "time_unit_unknown": "{file!r} has no unit of time; its values count as seconds.",
    "frames_missing": (
        "The numbers in the names leave out {frames}, first between {before!r} and {after!r}: a "
        "file may be missing. Frames are counted as they come; without stated times they count as "
        "evenly spaced."
    ),
    "no_animation": "No animation in the file moves a mesh: there is one frame.",
    "no_morph_targets": "The mesh has no morph targets: it moves as a rigid body.",
    "vertices_split": (
        "{n_vertices} vertices coincide with another: exporters split vertices along seams of "
        "normals and textures. Export without both to keep the surface whole."
    ),
    "arrays_renamed": "Read {arrays}.",
    "faces_from_1": "Faces count vertices from 1.",
    "displacement_added": "The displacement {array!r} was added to the vertices.",
    "unit_replaced": "The file is in {unit}; it was taken for {stated}, as stated.",
    "fact_replaced": "The file states another {fact} than its sender, whose statement counts.",
    "vtkhdf_time_unit_unknown": "The format has no unit of time; its values were read as seconds.",
    "read_as_surface": (
        "The file is a track: its surface was read, without the errors that it states."
    ),
    "nifti_position_unknown": (
        "The NIfTI file states no position in space; its axes are taken as RAS."
    ),
    "nrrd_space_unknown": "The NRRD file states no known space; its coordinates are taken as LPS.",
    "nrrd_unit_unknown": (
        "The NRRD file's unit of length is unknown; its coordinates are taken as mm."
    ),
    "files_not_used": "Not used ({reason}): {files}.",
    "interval_ignored": (
        "The {format} file states no unit for its interval of {interval:g} between frames, which "
        "is therefore ignored: state the interval in seconds."
    ),
    "planes_left_out": "Left out because they do not have {n_phases} phases: {planes}.",
    "planes_late": (
        "Later than the trigger by {first:.0f} to {last:.0f} ms: {planes}; phases are matched by "
        "their order."
    ),
    "trigger_times_unknown": (
        "The slices state no distinct trigger times; phases are in the order of their numbers."
    ),
    "frames_reordered": (
        "The frames were out of order (first: frame {first}) and were sorted by time; frames are "
        "counted in the new order."
    ),
    "frames_repeated": "Repeated at the same time and dropped: {frames} (first: frame {first}).",
    "several_openings": (
        "All {n_openings} openings are taken for one base; the modes of a cup fit such a surface "
        "less well than one with a single base."
    ),
    "coordinates_by_angle": "The triangles are too thin to solve on; s is the angle of the height.",
    "corners_unused": "The triangles are too thin to solve on; the corners were not used.",
    "curve_without_length": "The curve has no length; its vertices are taken to be evenly spread.",
    "areas_unknown": "There are no areas to weigh by; all vertices count alike.",
    "area_zero": "The surface has no area; all vertices count alike.",
    "vertices_without_weight": (
        "{n_vertices} vertices belong to no area and have no weight in the fit."
    ),
    "coordinates_fold": (
        "The coordinates fold: they cover their range {cover:.2f} times instead of once, so the "
        "surface is described badly. Where the axis is wrong, state {landmarks}, or another "
        "topology."
    ),
    "spring_modes_used": "{reason} The modes are those of springs along the edges of this mesh.",
    "vertices_merged": (
        "{vertices} of {n_all} coincide with an earlier one in every frame (first: vertex {first} "
        "with {other}) and were merged with it; amplitudes and errors count all that were sent."
    ),
    "vertices_isolated": (
        "{n_vertices} vertices belong to no triangle (first: {first}); they have no weight in the "
        "fit, and are moved as the nearest vertex of the surface."
    ),
    "triangles_degenerate": (
        "{n_triangles} triangles name a vertex twice (first: face {first}); they were left out."
    ),
    "triangles_repeated": "{triangles} repeat an earlier one (first: face {first}) and count once.",
    "kind_near_border": (
        "The kind of modes is near its border: the coordinates of a sphere cover this surface "
        "{cover:.2f} times, and below {border:g} it has the springs of its own mesh. Another "
        "recording of it may have the other kind; where several are compared, name one template "
        "or state one topology, sphere or mesh, for all."
    ),
    "mesh_modes": (
        "These are the spring modes of this mesh; their amplitudes compare with those of meshes "
        "of the same connectivity only."
    ),
    "modes_rounded": (
        "{asked} modes would split a cosine-sine pair; {n_modes} were fitted ({n_amplitudes} "
        "amplitudes a frame)."
    ),
    "not_compact": (
        "{n_modes} modes of {n_vertices} vertices are no longer compact: {ratio:.1f} coordinates "
        "for each amplitude of a frame. Ask for at most {most}, or keep the sequence itself as a "
        "stream (encode)."
    ),
    "motion_left": (
        "The residual of {n_modes} modes still shows motion above the noise, but {reason}."
    ),
    "deviations_from": "The standard deviations of the amplitudes follow from {source}.",
    "rotation_undetermined": (
        "The rotation is not determined in {frames} (first: frame {first}): the points span less "
        "than a plane or fit several rotations."
    ),
    "nothing_moves": "Nothing moves: every frame equals the reference.",
    "merged_vertices_apart": (
        "{vertices} that the template merges with another lie apart in this sequence (first: "
        "vertex {first} from {other}). They move together in its modes; the errors count each."
    ),
    "one_frame": "There is only one frame, so there is no motion to describe.",
    "unit_unknown": "The length unit is unknown; lengths are in the unit of the input.",
    "stored_rounded": (
        "The coordinates are stored as float32 far from the origin: they are rounded to "
        "{step:.2g}, which no fit can undo. Store float64, or shift the origin."
    ),
    "frame_unlike": (
        "Frame {frame} does not go with the others: half of its edges are {ratio:.3g} times as "
        "long as in the reference. Its vertices may be numbered otherwise, or be in another unit; "
        "send it again or leave it out."
    ),
    "vertex_astray": (
        "Frame {frame}, vertex {vertex} is out of place: each edge to its neighbours is at least "
        "{distance} {unit} longer than in the reference{more}. Correct the vertex or its number, "
        "or leave the frame out: the errors stated here count it."
    ),
    "noise_assumed": "One frame is too few to estimate noise; {size} was assumed.",
    "noise_of_rounding": (
        "The noise is that of the stored numbers, {size} a coordinate; no other shows, so modes "
        "are added until they describe rounding. Ask by tolerance for fewer."
    ),
    "ends_proposed": "Apex and base were proposed from the labels.",
    "landmark_outside": (
        "The landmark {landmark} is {distance:.0f} mm outside what is labelled in frame {frame}: "
        "check its place, and the system of its coordinates."
    ),
    "both_ends_open": (
        "Both ends of the labelled cavity are open: its lowest slice is {share:.0%} as large as "
        "its largest, so the apex was extrapolated; volumes depend on it."
    ),
    "slices_left_out": (
        "The highest slices are not labelled in {n_frames} frames (frame {first} is the first), "
        "though others have them: the base there was inferred from the other frames."
    ),
    "cavity_recognised": (
        "Label {label} was taken as the cavity, and label {wall}, which makes up {share:.0%} of "
        "its border, as its wall ({volumes}); if that is wrong, state the cavity's label."
    ),
    "one_label": (
        "The map has one label ({volumes}), which was used as the cavity; there is no wall."
    ),
    "points_not_used": (
        "{points} of the landmarks are called neither apex nor base ({names}) and were left out."
    ),
    "frames_without_edges": (
        "In {n_frames} frames, frame {first} the first, hardly any profile shows an edge "
        "(reference: {share:.0%}); there the motion is interpolated."
    ),
    "reference_unobserved": (
        "Too little was observed in the reference; the shape is that of frame {frame}."
    ),
    "points_thinned": (
        "{n_frames} frames have more than {most:,} points; as many of each were read."
    ),
    "along_surface": (
        "The motion follows the data along the surface's normals; along the surface it comes from "
        "the prior, with the stated standard deviation: twist and sliding are not measured."
    ),
    "treated_as_closed": (
        "The ends of the surface were not given, so it was treated as closed. If it is open, like "
        "a ventricle at its base, give the landmarks apex and base; otherwise its volumes are "
        "wrong."
    ),
    "ejection_fraction_uncertain": (
        "The ejection fraction is known to {points:.0f} percentage points only: the parts that "
        "determine its volumes were hardly observed."
    ),
    "base_from_data": (
        "The base is not stated in {frames} of {n_frames}: it was assumed where the data end (for "
        "slices, between the last one with a contour and the next, as the volume ejected has it). "
        "Give it if it is elsewhere."
    ),
    "base_from_volume": (
        "The base is not stated in {frames} of {n_frames}, and points do not show where an open "
        "surface ends: it was assumed by the volume ejected, as in adult hearts. Give it if you "
        "know it."
    ),
    "axis_unseen": "Hardly any of the surface is between apex and base: check both.",
    "axis_aside": (
        "The axis from apex to base is {distance:.3g} beside the middle of the surface, whose "
        "radius is {radius:.3g}: check both landmarks."
    ),
    "ends_swapped": (
        "The surface is wider near the apex ({apex:.3g}) than near the base ({base:.3g}): are the "
        "two swapped?"
    ),
    "measured_from_frame": (
        "The signature is measured from one frame, so the answer depends on which it is; fitted "
        "with the model's signature parameters, which name the mean shape, it does not."
    ),
    "tracking_unknown": (
        "It is not stated whether the points follow the tissue, so the class is based on the "
        "shape of the surface over time, which shows no twist. If they do (tagging, feature "
        "tracking), state tracking=material."
    ),
    "class_ruled_out": (
        "It moves most like {label}, but loses {share:.0%} of its volume, and training cases of "
        "that class {low:.0%} to {high:.0%}: that class is ruled out."
    ),
    "unlike_all": (
        "Unlike every class at {coverage:.0%}: {label} is the most probable, but less so than in "
        "{coverage:.0%} of the cases that are of it."
    ),
    "too_few_to_rule_out": (
        "Too few cases to rule out {classes} at a coverage of {coverage:.3g}: every class set "
        "contains {them}."
    ),
    "no_class": "No class: {reason}.",
    "subjects_unknown": (
        "No subjects are given, so each recording counted as a subject of its own. If some are of "
        "one person, give subjects; otherwise the accuracy is too optimistic."
    ),
    "class_spelling": (
        "The class {label!r} differs from {usual!r} in case or blanks alone: {cases}. If they are "
        "the same, spell them alike."
    ),
    "size_unlike": "{case} is {times:g} times as large as the others: check its unit.",
    "sizes_unlike": "The size of {cases} differs as much from the others': check units.",
    "confound": (
        "Possible confound: {finding} The model may have learnt how these recordings were made, "
        "or their subjects, instead of their motion."
    ),
    "cases_left_out": "Cases left out: {n_cases}.",
    "case_left_out": "Left out: {case}",
    "cases_also_left_out": "Also left out: {cases} not listed here.",
    "topology_imposed": "Their shapes are {shapes}; all are read as {basis}.",
    "cases_repeated": "{n_cases} cases came twice and counted once.",
    "modes_shared": "Not all have {most} modes: the first {n_modes} are read of all.",
    "tested_on_training": (
        "{n_trained} of the {n_cases} cases are in the training set: the figures are too "
        "optimistic. Test on other subjects, or read the card, whose figures are of held-out "
        "cases."
    ),
    "few_subjects": "{subjects}: so few understate how uncertain the differences are.",
    "own_folds": "The folds are the user's own.",
    "folds_torn": (
        "Subjects or groups on both sides of a split: {n_groups}. Cross-validation is too "
        "optimistic."
    ),
    "fold_without_class": "Fold {fold} had no case of {classes} to fit to.",
    "few_cases": (
        "Figures of so few cases ({n_cases}) are uncertain, even if all of them are right or a "
        "loss is 0. See the intervals, and train or test on more."
    ),
    "few_of_a_class": (
        "Fewer than {fewest} cases of {classes}: class sets of 90 % always contain {them}."
    ),
    "volume_alone": "The model reads the volume alone, not the motion of the surface.",
    "wall_unknown": (
        "No anterior landmark (theta_zero) was given, so the class is not assigned to a wall."
    ),
    "basis_chosen": (
        "The model reads {basis}, weighed inside each fold by log losses within training "
        "({losses}). State kind or topology to decide otherwise."
    ),
    "tracked": "The surface was tracked from {source}{convention}; intervals include its errors.",
    "volume_unlikely": (
        "The surface encloses {volume} ml, which no ventricle does: check the unit, which is "
        "stated as {unit}."
    ),
    "beat_too_long": (
        "The beat lasts {seconds:.3g} s, longer than any heartbeat: rates of ejection and filling "
        "are wrong if times are not in seconds. State the interval of frames in seconds, or send "
        "one beat alone."
    ),
    "nothing_ejected": "There is only one frame, so nothing is ejected.",
    "inside_out": (
        "In {frames} (first: frame {first}) {surface} is turned inside out: {share} would be "
        "above 100 %, which is impossible, so none is given. {remedy}"
    ),
    "cavity_unknown": (
        "It is not stated that this surface is a cavity, so the relative change of its volume is "
        "called volume change. State the fact cavity (lv, rv, la, ra or other) if it is one."
    ),
    "lines_from_pole_to_pole": (
        "The surface is closed, so lines run from pole to pole and no base is left out."
    ),
    "is_control": "It is one of the controls, and is compared with the others.",
    "covariate_unused": "{covariate} is not accounted for: {reason}.",
    "few_controls": (
        "With {controls} no p-value is below 1/{n_readings}; a level of {level} needs {needed}."
    ),
    "facts_filled": "The sequence was known; {facts} is known now too.",
    "facts_kept": (
        "The sequence was known, and keeps its facts; {facts} would now be different. PATCH "
        "changes them."
    ),
    "coordinates_by_height": (
        "The triangles are too thin to solve on; s is the height along the axis."
    ),
    "topology_doubtful": "{reason}",
    "landmark_undetermined": "{what} is not determined by the shape; state {landmarks}.{pairs}",
    "scene": "The scene is {scene}: {numbers} numbers a frame leave {rms:.3g} {unit} RMS.{modes}",
    "noise": (
        "The noise was estimated at {size} a coordinate (standard deviation; between {lowest:.3g} "
        "and {highest:.3g} {unit}), with correlations of {neighbours:.2f} between neighbours and "
        "{frames:.2f} between frames, from {n_modes} modes and what they leave.{doubt}"
    ),
    "frames_unobserved": (
        "Nothing was observed in {frames} of {n_frames}; there the motion is interpolated."
    ),
    "coverage_low": (
        "In {frames} points are at less than {share:.0%} of the surface (at least {least:.0%}); "
        "elsewhere the motion comes from the prior."
    ),
    "outliers": "In {frames} most points are outliers: they may belong to another object.",
    "points_away": (
        "In {frames} points are {distance:.3g} from the surface (RMS), more than a tenth of its "
        "radius of {radius:.3g}: they may fill a volume, or show several surfaces."
    ),
    "points_flat": (
        "In {frames} the points are in a plane or on a line: the volume beyond it was not observed."
    ),
    "frames_elsewhere": (
        "In {frames} the data are elsewhere, or of another size, than in the frames around: check "
        "the unit and the coordinates of each frame."
    ),
    "amplitudes_uncertain": (
        "The standard deviations of its amplitudes are {share:.0%} of them{consequence}."
    ),
    "class_of_one": (
        "The class {label!r} has one {what} only: its recognition in another {what} was not "
        "tested. {consequence}"
    ),
    "no_better_than_chance": (
        "Its answers to cases left out are no better than chance (AUC {auc:.2f}, 95 % interval "
        "{low:.2f} to {high:.2f}): do not rely on this model."
    ),
    "not_computed": "{reason}",
    "no_patient": "The model was trained on simulated ventricles only and has seen no patient.",
    "twist_needs_tissue": (
        "Torsion shows only where vertices follow the tissue (tagging, feature tracking). A "
        "surface fitted to contours slides over it, and looks as if it did not twist."
    ),
    "twist_unseen": (
        "Normal displacements do not show twist: a ventricle of reduced torsion that contracts as "
        "usual is called normal."
    ),
    "surface_alone": (
        "The model reads the surface alone, as it moves along the normals of its mean shape, and "
        "not where on it the points are."
    ),
    "is_backup": (
        "This is a backup: what was deleted since is in it. `modalmotion store restore` looks for "
        "deletions."
    ),
    "left_by_crash": "What is unfinished was left by a crash; opening the store repairs it.",
    "index_damaged": "The index was damaged: jobs and idempotency keys are lost.",
    "other_owners": "Those of other owners are not in it: --owner {owners}.",
    "deletions_unknown": (
        "What was deleted after {since} is in {folder} again: nothing here shows what that was. "
        "Remains of the old folder may: name them with --deletions."
    ),
    "published_errors": (
        "Published end-point errors are {mm} mm, of other recordings and landmarks; distances "
        "along the normal do not see motion within the surface and are smaller."
    ),
}
"""Texts of notes by their codes, with the names of their data."""


@shown("code", "text")
@dataclass(frozen=True)
class Note:
    """What to know of a result.

    Parameters
    ----------
    code : str
        Stays the same when the text is worded anew.
    text : str
        In words.
    data : dict of str to int, float or str
        What the text says of this result.
    """

    code: str
    text: str
    data: Mapping[str, int | float | str] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        return self.text

    def __contains__(self, words: str) -> bool:
        return words in self.text

    @staticmethod
    def of(code: str, /, **data: Any) -> "Note":
        """Word the note of a code, with its data."""
        plain = {name: one.item() if hasattr(one, "item") else one for name, one in data.items()}
        return Note(code, WORDS[code].format(**plain), plain)


def notes_as_json(notes: Iterable[Note]) -> list[dict[str, Any]]:
    """Write notes as JSON."""
    return [asdict(one) for one in notes]


def notes_from_json(values: Iterable[Mapping[str, Any]]) -> tuple[Note, ...]:
    """Read notes as `notes_as_json` writes them."""
    return tuple(Note(str(one["code"]), str(one["text"]), dict(one["data"])) for one in values)
