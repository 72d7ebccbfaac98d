"""Recipes of the shipped models: `python tools/train_shipped.py [NAME]`.

Each is trained on two makes of simulated hearts that differ in shape, time course, regional rule
and mesh, and states how it does on others of both.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from bullet import bullet_cohort
from numpy.random import default_rng

from modalmotion.classification.answer import classify
from modalmotion.classification.cases import TrainingCase
from modalmotion.classification.evaluation import evaluate
from modalmotion.classification.model import Model
from modalmotion.classification.model_files import (
    DEFAULT_MODEL,
    NORMAL_DISPLACEMENT_MODEL,
    RULE,
    model_to_hdf5,
)
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training import train
from modalmotion.mesh.sequence import MeshSequence, lattice_faces, mesh_sequence
from modalmotion.modes.topologies import CUP, CYLINDER
from modalmotion.notes import Note
from modalmotion.representation import plain
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    SignatureParameters,
    modal_signature,
)
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import MotionClass, simulate_cohort

TRAINING_SEED: Final = 1994
HELD_OUT_SEED: Final = 4711

# Hearts of each class and make that a model is tested on.
N_TEST: Final = 45

# Noise (mm), each of a part of the hearts.
_NOISES: Final = (0.2, 0.6, 1.0)
_FRAMES: Final = (12, 40)

# Of normal displacements: every so many hearts are seen as a track leaves them, and every so many
# lattices lack up to a share of their rows at the apex.
_EACH_TRACKED: Final = 3
_EACH_CUT: Final = 4
_MOST_CUT: Final = 0.25

# Modes that a track has by default, and points of a frame's cloud.
_N_TRACKED_MODES: Final = 37
_N_POINTS: Final = 2000

_HAS_NOT_SEEN: Final = (
    "Any patient, any other simulator, and any class but these: simulated motion is simpler than a "
    "patient's, and the classes are kept apart by construction, so the accuracy says nothing of "
    "the accuracy on patients."
)


@dataclass(frozen=True)
class Recipe:
    """How one of the shipped models is made.

    Parameters
    ----------
    name : str
    options : TrainingOptions
    n_train : int
        Hearts of each class and make.
    classes : tuple of MotionClass
        That it tells apart.
    notes : mapping of str to tuple of Note
        For every answer (under "") and for single classes.
    """

    name: str
    options: TrainingOptions
    n_train: int
    classes: tuple[MotionClass, ...]
    notes: Mapping[str, tuple[Note, ...]]


_OPTIONS: Final = TrainingOptions(
    topology=CUP.name, timing="cycle", repetitions=1, seed=TRAINING_SEED
)

RECIPES: Final = {
    recipe.name: recipe
    for recipe in (
        Recipe(
            DEFAULT_MODEL,
            replace(_OPTIONS, kind=SignatureKind.MATERIAL),
            300,
            tuple(MotionClass),
            {
                "": (Note.of("no_patient"),),
                MotionClass.REDUCED_TORSION: (Note.of("twist_needs_tissue"),),
            },
        ),
        Recipe(
            NORMAL_DISPLACEMENT_MODEL,
            replace(_OPTIONS, kind=SignatureKind.NORMAL_DISPLACEMENT),
            180,
            tuple(one for one in MotionClass if one != MotionClass.REDUCED_TORSION),
            {
                "": (Note.of("no_patient"), Note.of("surface_alone")),
                MotionClass.NORMAL: (Note.of("twist_unseen"),),
            },
        ),
    )
}


def shipped_model(recipe: Recipe, n_per_class: int) -> Model:
    """Train on as many hearts of each class and make."""
    cases = list(hearts(recipe, n_per_class, TRAINING_SEED, is_varied=True))
    model = train(cases, recipe.name, recipe.options)
    notes = {str(label): texts for label, texts in recipe.notes.items()}
    card = replace(
        model.card,
        has_seen=(
            f"{n_per_class} simulated left ventricles of each class and make (seed "
            f"{TRAINING_SEED}): spheroids and bullets with other time courses, regions and meshes, "
            f"from mild to severe, {_FRAMES[0]} to {_FRAMES[1]} frames, noise {_NOISES[0]} to "
            f"{_NOISES[-1]} mm."
        ),
        has_not_seen=_HAS_NOT_SEEN,
        extra={"has_seen_patients": False, "rule": RULE},
    )
    return replace(model, notes={**notes, "": (*notes[""], *model.notes.get("", ()))}, card=card)


def hearts(
    recipe: Recipe,
    n_per_class: int,
    seed: int,
    classes: Sequence[MotionClass] | None = None,
    *,
    is_varied: bool = False,
) -> Iterator[TrainingCase]:
    """Labelled signatures of hearts of both makes.

    Parameters
    ----------
    recipe : Recipe
    n_per_class : int
        Of each make, rounded up to a multiple of the number of noises.
    seed : int
    classes : sequence of MotionClass, optional
        Those of the recipe by default.
    is_varied : bool
        Whether surfaces of which normal displacements are read come as tracks leave them, too, and
        with the apex cut off.

    Yields
    ------
    TrainingCase
        Whose name begins with its make.
    """
    rng, n = default_rng(seed), -(-n_per_class // len(_NOISES))
    wanted = recipe.classes if classes is None else classes
    varies = is_varied and recipe.options.kind == SignatureKind.NORMAL_DISPLACEMENT
    for k, noise in enumerate(_NOISES):
        spheroids = (
            (case.sequence, case.label)
            for case in simulate_cohort(
                n, rng=rng, classes=wanted, noise=noise, any_start=k > 0, n_frames=_FRAMES
            )
        )
        bullets = bullet_cohort(n, rng=rng, classes=wanted, noise=noise, n_frames=_FRAMES)
        for make, drawn in (("spheroid", spheroids), ("bullet", bullets)):
            for number, (sequence, label) in enumerate(drawn):
                seen = sequence
                if varies and number // len(wanted) % _EACH_TRACKED == 1:
                    seen = as_tracked(sequence, rng)
                elif varies and number // len(wanted) % _EACH_CUT == 2:
                    seen = without_apex(sequence, rng)
                name = f"{make} {seed}-{noise}-{number}"
                yield TrainingCase(signature_of(recipe, seen), str(label), name, name)


def signature_of(recipe: Recipe, sequence: MeshSequence) -> ModalSignature:
    """Fit a surface as the recipe's model does: of normal displacements a cut apex is closed."""
    return modal_signature(sequence, recipe.options.signature_parameters)


def as_tracked(sequence: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """Reduce the motion of a cup to what a track through clouds of points keeps of it.

    Displacements from frame 0 are cut down to the modes of a track. The noise of an amplitude falls
    with the root of the number of points, so noise of the clouds' points is added by that much.
    """
    parameters = SignatureParameters(modes=_N_TRACKED_MODES, reference=0, topology=CUP.name)
    x = sequence.vertices.astype(np.float64)
    noise = rng.choice(_NOISES) * np.sqrt(x.shape[1] / _N_POINTS)
    seen = replace(sequence, vertices=x + rng.normal(0.0, noise, x.shape))
    return replace(sequence, vertices=reconstruct(modal_signature(seen, parameters), seen))


def without_apex(sequence: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """Cut rows of a lattice off at the apex; a mesh stays as it is."""
    if sequence.grid is None:
        return sequence
    n_rows, n_columns = sequence.grid
    lost = int(rng.integers(int(_MOST_CUT * n_rows) + 1))
    grid = (n_rows - lost, n_columns)
    return mesh_sequence(
        sequence.vertices[:, lost * n_columns :],
        lattice_faces(CYLINDER, grid),
        grid=grid,
        topology=CYLINDER,
        times=sequence.times,
        unit=sequence.unit,
        facts=sequence.facts,
    )


def held_out(recipe: Recipe, model: Model, n_per_class: int, seed: int) -> dict[str, Any]:
    """Test a shipped model on hearts of another seed, for its card.

    Under "held_out" all of them, and under "not_seen", where the model leaves a class out, how
    often it gives which answer for it.
    """
    record = plain(evaluate(model, hearts(recipe, n_per_class, seed)))
    for name in ("model", "model_id", "classes", "cases"):
        del record[name]
    figures: dict[str, Any] = {"held_out": {"seed": seed, **record}}
    left_out = [label for label in MotionClass if label not in recipe.classes]
    if left_out:
        cases = hearts(recipe, n_per_class, seed, left_out)
        answers = Counter(classify(case.motion, model).label or "no class" for case in cases)
        figures["not_seen"] = {str(label): dict(sorted(answers.items())) for label in left_out}
    return figures


def main(arguments: Sequence[str]) -> None:
    """Train models, all or by their names, test them on another seed, and write their files."""
    folder = Path(str(files("modalmotion.classification"))) / "data"
    for name in arguments or RECIPES:
        recipe = RECIPES[name]
        model = shipped_model(recipe, recipe.n_train)
        extra = {**model.card.extra, **held_out(recipe, model, N_TEST, HELD_OUT_SEED)}
        model = replace(model, card=replace(model.card, extra=extra))
        path = folder / f"{name}.h5"
        path.write_bytes(model_to_hdf5(model))
        sys.stdout.write(f"{path} {model.id}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
