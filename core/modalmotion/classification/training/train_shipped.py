"""Recipe of the shipped model: `python -m modalmotion.classification.training.train_shipped`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from numpy.random import default_rng

from modalmotion.classification.evaluation.evaluation import Evaluation, evaluate
from modalmotion.classification.model.hdf5 import model_to_hdf5
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import DEFAULT_MODEL
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.cases import TrainingCase
from modalmotion.classification.training.training import train
from modalmotion.modes.topology import CYLINDER
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import Case, MotionClass, simulate_cohort

MODES: Final = 7
TRAINING_SEED: Final = 1994
HELD_OUT_SEED: Final = 2026
N_TRAIN: Final = 200
N_TEST: Final = 400

# Noise (mm) and whether the recording starts anywhere in the beat, each for a quarter of the
# training cases; held-out cases have the same mixture.
RECORDINGS: Final = ((0.2, False), (0.6, False), (0.6, True), (1.0, True))
FRAMES: Final = (12, 40)

_PARAMETERS: Final = TrainingOptions(modes=MODES, further=False).signature_parameters

_NO_PATIENT: Final = "The model was trained on simulated ventricles only and has seen no patient."
_TORSION: Final = (
    "Torsion shows only where vertices follow the tissue (tagging, feature tracking). A surface "
    "fitted to contours slides over it, and looks as if it did not twist."
)


def shipped_model(n_per_class: int, *, seed: int = TRAINING_SEED) -> Model:
    """Train on a simulated cohort.

    Parameters
    ----------
    n_per_class : int
        Rounded up to a multiple of the number of kinds of recording.
    seed : int
    """
    model = train(
        training_cases(n_per_class, seed),
        DEFAULT_MODEL,
        TrainingOptions(modes=MODES, further=False, seed=seed),
    )
    notes = {
        "": (_NO_PATIENT, *model.notes.get("", ())),
        str(MotionClass.REDUCED_TORSION): (_TORSION,),
    }
    card = replace(
        model.card,
        has_seen=(
            f"{n_per_class} simulated left ventricles of each class (seed {seed}): kinematic "
            "model, severities from mild to severe, lattices (as cup and as cylinder) and "
            f"triangulations, {FRAMES[0]} to {FRAMES[1]} frames, noise 0.2 to 1.0 mm, half of "
            "them starting anywhere in the beat."
        ),
        has_not_seen=(
            "Any patient. Simulated motion is simpler than a patient's, and the classes are kept "
            "apart by construction: the accuracy says nothing of the accuracy on patients."
        ),
        extra={"has_seen_patients": False},
    )
    return replace(model, notes=notes, card=card)


def training_cases(n_per_class: int, seed: int) -> Iterator[TrainingCase]:
    """Labelled signatures of a simulated cohort.

    Each case as a cup and, where it is a lattice, also as the cylinder that some will state.

    Parameters
    ----------
    n_per_class : int
        Rounded up to a multiple of the number of kinds of recording.
    seed : int

    Yields
    ------
    TrainingCase
    """
    for number, case in enumerate(_cohort(n_per_class, seed)):
        subject = f"simulated {seed}-{number}"
        label = str(case.label)
        yield TrainingCase(modal_signature(case.sequence, _PARAMETERS), label, subject)
        if case.sequence.grid is not None:
            as_cylinder = replace(case.sequence, topology=CYLINDER)
            yield TrainingCase(modal_signature(as_cylinder, _PARAMETERS), label, subject)


def held_out_cases(n_per_class: int, seed: int = HELD_OUT_SEED) -> Iterator[TrainingCase]:
    """Labelled signatures of a cohort of another seed, each as the cup that it is."""
    for case in _cohort(n_per_class, seed):
        yield TrainingCase(modal_signature(case.sequence, _PARAMETERS), str(case.label))


def main(arguments: Sequence[str]) -> None:
    """Train, test on a cohort of another seed, and write the model file."""
    default = Path(__file__).parents[1] / "model" / "data" / f"{DEFAULT_MODEL}.h5"
    path = Path(arguments[0]) if arguments else default
    model = shipped_model(N_TRAIN)
    evaluation = evaluate(model, held_out_cases(N_TEST))
    extra = {**model.card.extra, **_held_out(evaluation)}
    model = replace(model, card=replace(model.card, extra=extra))
    path.write_bytes(model_to_hdf5(model))
    sys.stdout.write(f"{path} {model.id}\n{evaluation}\n")


def _held_out(evaluation: Evaluation) -> dict[str, object]:
    record = evaluation.as_json()
    for name in ("model", "model_id", "classes", "cases"):
        del record[name]
    return {"held_out": {"seed": HELD_OUT_SEED, **record}}


def _cohort(n_per_class: int, seed: int) -> Iterator[Case]:
    rng = default_rng(seed)
    for noise, any_start in RECORDINGS:
        yield from simulate_cohort(
            -(-n_per_class // len(RECORDINGS)),
            rng=rng,
            noise=noise,
            any_start=any_start,
            n_frames=FRAMES,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
