"""A model: what it reads, how it scores, how sure it may be, and what it is for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import scipy

from modalmotion.arguments.checking import FrozenArrays, Plotted, Saved
from modalmotion.classification import motion_features, performance
from modalmotion.classification.card import ModelCard
from modalmotion.classification.motion import Column, Motion
from modalmotion.classification.outliers import OutlierDetector
from modalmotion.errors import TopologyError
from modalmotion.modes.topologies import CUP, CYLINDER, MESH, Topology
from modalmotion.notes import Note, notes_as_json
from modalmotion.representation import Array, Bools, Floats, Ints, shown
from modalmotion.signature.making import SignatureKind, SignatureParameters
from modalmotion.signature.parameters import parameters_as_json, parameters_from_json

if TYPE_CHECKING:
    from modalmotion import Classification

# Rounding of 1 - coverage.
_ROUNDING: Final = 1e-9

# Noise of shares of a volume, and cases of a class below which its range is not known.
_NOISE_OF_SHARES: Final = 0.01
_FEWEST_OF_RANGE: Final = 20

OF_MODEL: Final = ("weights", "intercepts", "centre", "shares")
OF_DETECTOR: Final = (
    *("means", "whitening", "points", "scales"),
    *("directions", "signs", "limits", "bounds"),
)
"""Arrays that answers depend on."""

Arrays = dict[str, Array]


@shown()
@dataclass(frozen=True)
class Readable:
    """Which signatures a model reads.

    Parameters
    ----------
    topology : str
        "mesh" for the spring modes of one mesh.
    n_modes : int
    connectivity_id : str
        Of that mesh; empty for modes in closed form.
    parameters : SignatureParameters
        Of the signatures; landmarks may differ, and so may the frame if the reference is one.
    """

    topology: str
    n_modes: int
    connectivity_id: str
    parameters: SignatureParameters

    def imposed_on(self, surface: str, stated: Topology | str | None) -> SignatureParameters | None:
        """Parameters that impose the model's topology on a sequence; None if they need not.

        Parameters
        ----------
        surface : str
            Topology of the signature that the sequence has with `parameters`.
        stated : Topology, str or None
            As the sequence states it. That is set aside for an apex that was cut off alone: see
            `closes_apices`.

        Raises
        ------
        TopologyError
            If the model's topology was imposed on a sequence that states another.
        """
        name = None if stated is None else Topology.parse(str(stated)).name
        is_free = name is None or (self.closes_apices and name == CYLINDER.name)
        if surface == self.topology:
            if is_free or name == surface or surface == MESH:
                return None
            raise TopologyError(
                f"The sequence has the topology {name}, but the model reads a {surface}.",
                remedy="Set the topology if it is wrong, or train a model for this one.",
            )
        return replace(self.parameters, topology=self.topology) if is_free else None

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        return {**asdict(self), "parameters": parameters_as_json(self.parameters)}

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> Readable:
        """Read the output of `as_json`."""
        return Readable(**{**values, "parameters": parameters_from_json(values["parameters"])})

    @property
    def closes_apices(self) -> bool:
        """Whether it takes cylinders as cups of which the apex was cut off.

        Of normal displacements on cups, which do not depend on where the surface ends.
        """
        return self.parameters.kind != SignatureKind.MATERIAL and self.topology == CUP.name


@shown("name", "classes", "readable.topology", "readable.n_modes", "id")
@dataclass(frozen=True, eq=False)
class Model(FrozenArrays, Saved, Plotted):
    """A classifier of motions that is trained.

    Parameters
    ----------
    name : str
    classes : tuple of str
    readable : Readable
    tables : tuple of Extractor
        Tables of features, side by side.
    columns : tuple of Column
        Of all of them.
    weights : (features, classes) float64
        Log probabilities are features @ weights + intercepts, up to a constant: the weighted mean
        of the tables' own, each over its temperature (a logarithmic opinion pool; Genest and
        Zidek, Combining probability distributions, Statistical Science, 1986).
    intercepts : (classes,) float64
    centre : (features,) float64
        Features of an average training case.
    outliers : OutlierDetector
    shares : (classes, 2) float64
        Least and largest share of the volume that training cases of each class lose, with a
        margin; infinite where it is not known.
    strangeness : tuple of (cases,) float64
        1 - (probability of the true class) of held-out cases, by class, in increasing order.
    notes : dict of str to tuple of Note
        Notes for every answer (under "") or for one class.
    card : ModelCard
    cross_validation : CrossValidation or None
        Answers to the training cases, held out. Not part of the id: no answer depends on it.
    """

    name: str
    classes: tuple[str, ...]
    readable: Readable
    tables: tuple[motion_features.Extractor, ...]
    columns: tuple[Column, ...]
    weights: Floats
    intercepts: Floats
    centre: Floats
    outliers: OutlierDetector
    shares: Floats
    strangeness: tuple[Floats, ...]
    notes: dict[str, tuple[Note, ...]]
    card: ModelCard
    cross_validation: performance.CrossValidation | None = None

    @cached_property
    def id(self) -> str:
        """Identity: sha256 in hex of everything that an answer depends on."""
        arrays, texts = answering_parts(self)
        digest = hashlib.sha256(json.dumps(texts, sort_keys=True).encode())
        for name, array in sorted(arrays.items()):
            digest.update(f"{name} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()

    def classify(self, motion: Any, **options: Any) -> Classification:
        """Name the class of a motion: see `modalmotion.classify`."""
        import modalmotion

        return modalmotion.classify(motion, self, **options)

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Parameters of the signatures it reads."""
        return self.readable.parameters

    @property
    def walls(self) -> bool:
        """Whether walls are distinguished, so that the zero of theta must be known."""
        return any(table.walls and table.reads_motion for table in self.tables)

    @cached_property
    def reads(self) -> Floats:
        """1 where a feature is read from a mode, (features, modes)."""
        found = np.zeros((len(self.columns), self.readable.n_modes))
        for row, column in zip(found, self.columns, strict=True):
            row[list(column.modes)] = 1.0
        return found

    def features(self, motion: Motion) -> Floats:
        """Features of a motion, of all tables, (features,)."""
        return np.concatenate([table.values(motion) for table in self.tables])

    def probabilities(self, features: Floats) -> Floats:
        """Probabilities, (cases, classes), of features (cases, features)."""
        scores = features @ self.weights + self.intercepts
        return np.asarray(scipy.special.softmax(scores, axis=1))

    def contradicts(self, share: float) -> Bools:
        """Which classes the share of the volume that is lost rules out, (classes,).

        None where it is not known.
        """
        low, high = self.shares.T
        return np.asarray((share < low) | (share > high))

    def too_few(self, coverage: float) -> tuple[str, ...]:
        """Classes with fewer than 1 / (1 - coverage) - 1 cases, which every set must hold."""
        least = 1.0 / (1.0 - coverage) - 1.0 - 1e-6
        return tuple(
            label
            for label, scores in zip(self.classes, self.strangeness, strict=True)
            if len(scores) < least
        )


def strangeness_of(probabilities: Floats, y: Ints) -> tuple[Floats, ...]:
    """Strangeness of held-out cases, 1 - (probability of the true class), sorted, by class."""
    strange = 1.0 - probabilities[np.arange(len(y)), y]
    return tuple(np.sort(strange[y == k]) for k in range(probabilities.shape[1]))


def holds(strangeness: tuple[Floats, ...], probabilities: Floats, coverage: float) -> Bools:
    """Which classes are in the set that holds the true one with the requested frequency.

    Parameters
    ----------
    strangeness : tuple of (cases,) float64
        Of held-out cases, by class: see `strangeness_of`.
    probabilities : (cases, classes) float64
    coverage : float

    Returns
    -------
    (cases, classes) bool

    Notes
    -----
    Vovk, Conditional validity of inductive conformal predictors, Machine Learning, 2013 (class by
    class), with the scores of cross-validation, so that no case is lost (Vovk, Cross-conformal
    predictors, Ann Math Artif Intell, 2015). A class stays unless fewer than a share 1 - coverage
    of its n held-out cases and the case itself are as strange: (number as strange + 1) / (n + 1) >
    1 - coverage.
    """
    alpha = 1.0 - coverage
    in_set = np.empty(probabilities.shape, dtype=np.bool_)
    for k, scores in enumerate(strangeness):
        n = len(scores)
        as_strange = n - np.searchsorted(scores, 1.0 - probabilities[:, k], side="left")
        in_set[:, k] = as_strange + 1 > alpha * (n + 1) + _ROUNDING
    return in_set


def share_ranges(shares: Floats, y: Ints, n_classes: int) -> Floats:
    """Ranges of the volume share of each class, (classes, 2): see `Model.shares`.

    Of n cases spread evenly the range is short of the true one by two parts in n + 1: it is made
    longer by that on either side, and by a point of noise.
    """
    ranges = np.tile([-np.inf, np.inf], (n_classes, 1))
    for k in range(n_classes):
        own = shares[y == k]
        if len(own) >= _FEWEST_OF_RANGE and np.isfinite(own).all():
            margin = 2.0 * float(np.ptp(own)) / (len(own) + 1) + _NOISE_OF_SHARES
            ranges[k] = own.min() - margin, own.max() + margin
    return ranges


def answering_parts(model: Model) -> tuple[Arrays, dict[str, Any]]:
    """Take all of a model that an answer depends on to arrays and JSON values."""
    detector, readable = model.outliers, model.readable
    arrays: Arrays = {
        **{name: getattr(model, name) for name in OF_MODEL},
        "n_strangeness": np.array([len(own) for own in model.strangeness], dtype=np.int64),
        "strangeness": np.concatenate(model.strangeness),
        **{name: getattr(detector, name) for name in OF_DETECTOR},
    }
    texts = {
        "name": model.name,
        "classes": model.classes,
        "readable": readable.as_json(),
        "tables": [one.as_json() for one in model.tables],
        "columns": model.columns,
        "detector": {
            "reader": detector.reader.as_json(),
            "knows_size": detector.knows_size,
            "has_unit": detector.has_unit,
        },
        "notes": {label: notes_as_json(said) for label, said in model.notes.items()},
    }
    return arrays, texts
