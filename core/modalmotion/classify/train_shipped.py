"""Recipe of the shipped model: `python -m modalmotion.classify.train_shipped [FILE]`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.classify.classifier import classify
from modalmotion.classify.model import DEFAULT_MODEL, Model, model_to_bytes
from modalmotion.classify.training import train_model
from modalmotion.signature import INTENDED_USE, ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import Case, MotionClass, simulate_cohort
from modalmotion.topology import CYLINDER

MODES: Final = 7
TRAINING_SEED: Final = 1994
HELD_OUT_SEED: Final = 2026

# Noise (mm) and whether the recording starts anywhere in the beat, each for a quarter of the
# training cases; held-out cases have the same mixture.
RECORDINGS: Final = ((0.2, False), (0.6, False), (0.6, True), (1.0, True))
FRAMES: Final = (12, 40)

_PARAMETERS: Final = SignatureParameters(modes=MODES)

NOTES: Final[dict[str, tuple[str, ...]]] = {
    "": ("The model was trained on simulated ventricles only and has seen no patient.",),
    str(MotionClass.REDUCED_TORSION): (
        (
            "Torsion shows only where vertices follow the tissue (tagging, feature tracking). A "
            "surface fitted to contours slides over it, and looks as if it did not twist."
        ),
    ),
}


def shipped_model(n_per_class: int, *, seed: int = TRAINING_SEED) -> Model:
    """Train on a simulated cohort.

    Parameters
    ----------
    n_per_class : int
        Rounded up to a multiple of the number of kinds of recording.
    seed : int
    """
    return train_model(DEFAULT_MODEL, training_signatures(n_per_class, seed), notes=NOTES)


def training_signatures(n_per_class: int, seed: int) -> Iterator[tuple[ModalSignature, str]]:
    """Labelled signatures of a simulated cohort.

    Each case as a cup and, where it is a lattice, also as the cylinder that some will state.

    Parameters
    ----------
    n_per_class : int
        Rounded up to a multiple of the number of kinds of recording.
    seed : int

    Yields
    ------
    (ModalSignature, str)
    """
    for case in _cohort(n_per_class, seed):
        yield modal_signature(case.sequence, _PARAMETERS), case.label
        if case.sequence.grid is not None:
            as_cylinder = replace(case.sequence, topology=CYLINDER)
            yield modal_signature(as_cylinder, _PARAMETERS), case.label


@dataclass(frozen=True, eq=False)
class HeldOut:
    """How a model does on cases it has not seen.

    Parameters
    ----------
    classes : tuple of str
    confusion : (classes, classes + 1) int64
        Rows are true classes; the last column counts abstentions.
    calibration_error : float
        Expected difference between the probability of the label and the share that is right,
        in ten bins.
    """

    classes: tuple[str, ...]
    confusion: np.ndarray[Any, np.dtype[np.int64]]
    calibration_error: float

    @property
    def accuracy(self) -> float:
        """Share of all cases with the right label; an abstention is none."""
        return float(np.trace(self.confusion) / self.confusion.sum())

    @property
    def abstained(self) -> float:
        """Share of cases without a label."""
        return float(self.confusion[:, -1].sum() / self.confusion.sum())


def held_out(model: Model, signatures: Sequence[tuple[ModalSignature, str]]) -> HeldOut:
    """Test a model on labelled signatures."""
    confusion = np.zeros((len(model.classes), len(model.classes) + 1), dtype=np.int64)
    confidence, right = [], []
    for signature, label in signatures:
        answer = classify(signature, model)
        row = model.classes.index(label)
        column = -1 if answer.label is None else model.classes.index(answer.label)
        confusion[row, column] += 1
        if answer.label is not None:
            confidence.append(answer.probability)
            right.append(answer.label == label)
    bins = np.minimum((np.array(confidence) * 10).astype(int), 9)
    gaps = np.bincount(bins, np.array(confidence) - np.array(right), minlength=10)
    return HeldOut(model.classes, confusion, float(np.abs(gaps).sum() / max(len(right), 1)))


def main(arguments: Sequence[str]) -> None:
    """Train, test on a cohort of another seed, and write the model file."""
    default = Path(__file__).parent / "data" / f"{DEFAULT_MODEL}.json"
    path = Path(arguments[0]) if arguments else default
    n_train, n_test = 300, 100
    model = shipped_model(n_train)
    tested: dict[str, list[tuple[ModalSignature, str]]] = {"lattice": [], "triangles": []}
    for case in _cohort(n_test, HELD_OUT_SEED):
        mesh = "triangles" if case.sequence.grid is None else "lattice"
        tested[mesh].append((modal_signature(case.sequence, _PARAMETERS), case.label))
    results = {mesh: held_out(model, cases) for mesh, cases in tested.items()}
    results["all"] = held_out(model, [case for cases in tested.values() for case in cases])
    model = replace(model, card=_card(n_train, n_test, results))
    path.write_bytes(model_to_bytes(model))
    sys.stdout.write(f"{path} {model.id}\n")
    for mesh, result in results.items():
        sys.stdout.write(
            f"{mesh}: accuracy {result.accuracy:.3f}, abstained {result.abstained:.3f}, "
            f"calibration error {result.calibration_error:.3f}\n{result.confusion}\n"
        )


def _cohort(n_per_class: int, seed: int) -> Iterator[Case]:
    rng = np.random.default_rng(seed)
    for noise, any_start in RECORDINGS:
        yield from simulate_cohort(
            -(-n_per_class // len(RECORDINGS)),
            rng=rng,
            noise=noise,
            any_start=any_start,
            n_frames=FRAMES,
        )


def _card(n_train: int, n_test: int, results: dict[str, HeldOut]) -> dict[str, Any]:
    return {
        "intended_use": INTENDED_USE,
        "trained_on": (
            f"{n_train} simulated left ventricles of each class (seed {TRAINING_SEED}): "
            "kinematic model, severities from mild to severe, lattices (as cup and as "
            f"cylinder) and triangulations, {FRAMES[0]} to {FRAMES[1]} frames, noise "
            "0.2 to 1.0 mm, half of them starting anywhere in the beat."
        ),
        "has_seen_patients": False,
        "limits": (
            "Simulated motion is simpler than a patient's, and the classes are kept apart by "
            "construction: the accuracy below says nothing of the accuracy on patients."
        ),
        "features": "docs/simulation.md",
        "estimator": "multinomial logistic regression on standardised features",
        "versions": {name: version(name) for name in ("modalmotion", "numpy", "scikit-learn")},
        "held_out": {
            "cases_per_class": n_test,
            "seed": HELD_OUT_SEED,
            "confusion": "rows: true class; columns: answers, the last one abstentions",
            **{
                mesh: {
                    "accuracy": round(result.accuracy, 4),
                    "abstained": round(result.abstained, 4),
                    "calibration_error": round(result.calibration_error, 4),
                    "confusion": result.confusion.tolist(),
                }
                for mesh, result in results.items()
            },
        },
    }


if __name__ == "__main__":
    main(sys.argv[1:])
