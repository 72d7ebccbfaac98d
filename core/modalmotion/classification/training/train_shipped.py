"""Recipes of the shipped models: `python -m modalmotion.classification.training.train_shipped`."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from numpy.random import Generator, default_rng

from modalmotion.classification.answer.classifier import classify
from modalmotion.classification.evaluation.evaluation import Evaluation, evaluate
from modalmotion.classification.model.hdf5 import model_to_hdf5
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import DEFAULT_MODEL, OFFSET_MODEL, RULE
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.as_tracked import N_MODES, N_POINTS, as_tracked
from modalmotion.classification.training.cases import TrainingCase
from modalmotion.classification.training.training import train
from modalmotion.mesh.lattice_triangles import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CUP, CYLINDER
from modalmotion.signature.making import ModalSignature, SignatureKind, modal_signature
from modalmotion.simulate import Case, MotionClass, simulate_cohort

TRAINING_SEED: Final = 1994
HELD_OUT_SEED: Final = 2026
N_TEST: Final = 400
# Simulated recordings are as like one another as no others are: strangers may be told sooner.
KNOWN_SHARE: Final = 0.99

# Noise (mm) and whether the recording starts anywhere in the beat, each for a quarter of the
# training cases; held-out cases have the same mixture.
RECORDINGS: Final = ((0.2, False), (0.6, False), (0.6, True), (1.0, True))
FRAMES: Final = (12, 40)

_NO_PATIENT: Final = "The model was trained on simulated ventricles only and has seen no patient."
_TORSION: Final = (
    "Torsion shows only where vertices follow the tissue (tagging, feature tracking). A surface "
    "fitted to contours slides over it, and looks as if it did not twist."
)
_NO_TWIST: Final = (
    "Offsets do not show twist: a ventricle of reduced torsion that contracts as usual is called "
    "normal."
)
_SURFACE_ALONE: Final = (
    "The model reads the surface alone, as it lies along the normals of its mean shape, and not "
    "where on it the points are."
)


@dataclass(frozen=True)
class Recipe:
    """How one of the shipped models is made.

    Parameters
    ----------
    name : str
    options : TrainingOptions
    classes : tuple of MotionClass
        That it tells apart.
    notes : mapping of str to tuple of str
        For every answer (under "") and for single classes.
    most_cut : float
        Share of its rows that a lattice may lack at the apex as a cylinder.
    n_train : int
        Ventricles of each class that the model is trained on (decisions 9 and 53).
    tracked_seed : int or None
        Of as many further ventricles, which are seen as tracks leave them: see `as_tracked`.
    """

    name: str
    options: TrainingOptions
    classes: tuple[MotionClass, ...]
    notes: Mapping[str, tuple[str, ...]]
    most_cut: float = 0.0
    n_train: int = 200
    tracked_seed: int | None = None


MATERIAL: Final = Recipe(
    DEFAULT_MODEL,
    TrainingOptions(
        modes=12,
        kind=SignatureKind.MATERIAL,
        further=False,
        known_share=KNOWN_SHARE,
        seed=TRAINING_SEED,
    ),
    tuple(MotionClass),
    {"": (_NO_PATIENT,), MotionClass.REDUCED_TORSION: (_TORSION,)},
)

OFFSET: Final = Recipe(
    OFFSET_MODEL,
    TrainingOptions(
        modes=16,
        kind=SignatureKind.OFFSET,
        timing="cycle",
        further=False,
        known_share=KNOWN_SHARE,
        seed=TRAINING_SEED,
    ),
    tuple(one for one in MotionClass if one != MotionClass.REDUCED_TORSION),
    {"": (_NO_PATIENT, _SURFACE_ALONE), MotionClass.NORMAL: (_NO_TWIST,)},
    most_cut=0.25,
    n_train=800,
    tracked_seed=31994,
)

RECIPES: Final = {recipe.name: recipe for recipe in (MATERIAL, OFFSET)}


def shipped_model(recipe: Recipe, n_per_class: int) -> Model:
    """Train on a simulated cohort.

    Parameters
    ----------
    recipe : Recipe
    n_per_class : int
        Rounded up to a multiple of the number of kinds of recording.
    """
    seed = recipe.options.seed
    model = train(training_cases(recipe, n_per_class), recipe.name, recipe.options)
    notes = {str(label): texts for label, texts in recipe.notes.items()}
    notes[""] = (*notes[""], *model.notes.get("", ()))
    cut = ", and as cylinder with the apex cut off by up to a quarter"
    ways = f"as cup{cut if recipe.most_cut else ' and as cylinder'}"
    tracked = (
        f" And as many others (seed {recipe.tracked_seed}) as tracks leave them: {N_MODES} modes "
        f"of displacements, fitted to clouds of {N_POINTS:,} points with the same noise."
    )
    card = replace(
        model.card,
        has_seen=(
            f"{n_per_class} simulated left ventricles of each class (seed {seed}): kinematic "
            f"model, severities from mild to severe, lattices ({ways}) and "
            f"triangulations, {FRAMES[0]} to {FRAMES[1]} frames, noise 0.2 to 1.0 mm, half of "
            f"them starting anywhere in the beat.{tracked if recipe.tracked_seed else ''}"
        ),
        has_not_seen=(
            "Any patient. Simulated motion is simpler than a patient's, and the classes are kept "
            "apart by construction: the accuracy says nothing of the accuracy on patients."
        ),
        extra={"has_seen_patients": False, "rule": RULE},
    )
    return replace(model, notes=notes, card=card)


def training_cases(recipe: Recipe, n_per_class: int) -> Iterator[TrainingCase]:
    """Labelled signatures of a simulated cohort.

    Each case as a cup and, where it is a lattice, also as the cylinder that some will state; then,
    if the recipe says so, others as tracks leave them.

    Parameters
    ----------
    recipe : Recipe
    n_per_class : int
        Rounded up to a multiple of the number of kinds of recording.

    Yields
    ------
    TrainingCase
    """
    seed = recipe.options.seed
    for number, case in enumerate(_cohort(n_per_class, seed, recipe.classes)):
        subject = f"simulated {seed}-{number}"
        for sequence in surfaces_of(case, recipe.most_cut):
            yield TrainingCase(_signature(recipe, sequence), str(case.label), subject)
    if recipe.tracked_seed is not None:
        yield from _tracked_cases(recipe, n_per_class, recipe.tracked_seed)


def held_out_cases(recipe: Recipe, n_per_class: int, seed: int) -> Iterator[TrainingCase]:
    """Labelled signatures of a cohort of another seed, each as the cup that it is."""
    for case in _cohort(n_per_class, seed, recipe.classes):
        yield TrainingCase(_signature(recipe, case.sequence), str(case.label))


def surfaces_of(case: Case, most_cut: float) -> tuple[MeshSequence, ...]:
    """Give the case as the cup that it is and, if it is a lattice, as a cylinder.

    Who states a cylinder has a surface that is open at both ends: of its rows up to a share are
    cut off at the apex, as the digits of its id say.
    """
    sequence = case.sequence
    if sequence.grid is None:
        return (sequence,)
    if most_cut == 0.0:
        return sequence, replace(sequence, topology=CYLINDER)
    n_rows, n_columns = sequence.grid
    first = int(sequence.id[:8], 16) % (int(most_cut * n_rows) + 1)
    grid = (n_rows - first, n_columns)
    open_at_both = mesh_sequence(
        sequence.vertices[:, first * n_columns :],
        lattice_faces(CYLINDER, grid),
        grid=grid,
        topology=CYLINDER,
        times=sequence.times,
        unit=sequence.unit,
        facts=sequence.facts,
    )
    return sequence, open_at_both


def held_out(
    recipe: Recipe, model: Model, n_per_class: int, seed: int = HELD_OUT_SEED
) -> dict[str, object]:
    """Test a shipped model on a cohort of another seed, for its card.

    Parameters
    ----------
    recipe : Recipe
    model : Model
    n_per_class : int
    seed : int

    Returns
    -------
    dict of str to object
        Under "held_out" the test of all cases, each as the cup that it is; under
        "held_out_by_surface" that of lattices as cups and as cylinders, and of meshes; under
        "not_seen", where the model leaves a class out, how often it gives which answer for it.
    """
    by_surface: dict[str, list[TrainingCase]] = {}
    unseen: Counter[str] = Counter()
    for case in _cohort(n_per_class, seed, tuple(MotionClass)):
        if case.label not in recipe.classes:
            answer = classify(_signature(recipe, case.sequence), model)
            unseen[answer.label or "no class"] += 1
            continue
        for sequence in surfaces_of(case, recipe.most_cut):
            name = "meshes"
            if sequence.grid is not None:
                name = "lattices as cylinders" if sequence.topology == CYLINDER else "lattices"
            signature = _signature(recipe, sequence)
            by_surface.setdefault(name, []).append(TrainingCase(signature, str(case.label)))
    own = [case for name in ("lattices", "meshes") for case in by_surface[name]]
    brief = ("accuracy", "accuracy_interval", "calibration_error", "n_cases")
    parts = {name: evaluate(model, cases).as_json() for name, cases in sorted(by_surface.items())}
    figures: dict[str, object] = {
        "held_out": {"seed": seed, **_record(evaluate(model, own))},
        "held_out_by_surface": {
            name: {figure: part[figure] for figure in brief} for name, part in parts.items()
        },
    }
    if unseen:
        figures["not_seen"] = {
            str(label): dict(sorted(unseen.items()))
            for label in MotionClass
            if label not in recipe.classes
        }
    return figures


def main(arguments: Sequence[str]) -> None:
    """Train models, all or by their names, test them on another seed, and write their files."""
    folder = Path(__file__).parents[1] / "model" / "data"
    for name in arguments or RECIPES:
        recipe = RECIPES[name]
        model = shipped_model(recipe, recipe.n_train)
        extra = {**model.card.extra, **held_out(recipe, model, N_TEST)}
        model = replace(model, card=replace(model.card, extra=extra))
        path = folder / f"{name}.h5"
        path.write_bytes(model_to_hdf5(model))
        sys.stdout.write(f"{path} {model.id}\n")


def _signature(recipe: Recipe, sequence: MeshSequence) -> ModalSignature:
    """Fit a surface as the recipe's model does: of offsets a cut apex is closed again."""
    parameters = recipe.options.signature_parameters
    if parameters.kind == SignatureKind.OFFSET and sequence.topology == CYLINDER:
        parameters = replace(parameters, topology=CUP.name)
    return modal_signature(sequence, parameters)


def _record(evaluation: Evaluation) -> dict[str, object]:
    record = evaluation.as_json()
    for name in ("model", "model_id", "classes", "cases"):
        del record[name]
    return record


def _tracked_cases(recipe: Recipe, n_per_class: int, seed: int) -> Iterator[TrainingCase]:
    """Simulate further ventricles without noise, as tracks through noisy clouds leave them."""
    rng, number = default_rng(seed), 0
    for noise, any_start in RECORDINGS:
        for case in _drawn(n_per_class, rng, recipe.classes, 0.0, any_start=any_start):
            sequence = as_tracked(case.sequence, noise, default_rng([seed, number]))
            subject = f"tracked {seed}-{number}"
            yield TrainingCase(_signature(recipe, sequence), str(case.label), subject)
            number += 1


def _cohort(n_per_class: int, seed: int, classes: tuple[MotionClass, ...]) -> Iterator[Case]:
    rng = default_rng(seed)
    for noise, any_start in RECORDINGS:
        yield from _drawn(n_per_class, rng, classes, noise, any_start=any_start)


def _drawn(
    n_per_class: int,
    rng: Generator,
    classes: tuple[MotionClass, ...],
    noise: float,
    *,
    any_start: bool,
) -> Iterator[Case]:
    """Draw one kind of recording's share of a cohort."""
    return simulate_cohort(
        -(-n_per_class // len(RECORDINGS)),
        rng=rng,
        classes=classes,
        noise=noise,
        any_start=any_start,
        n_frames=FRAMES,
    )


if __name__ == "__main__":
    main(sys.argv[1:])
