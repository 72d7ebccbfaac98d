"""A model: what it reads, how it scores, how sure it may be, and what it is for."""

from __future__ import annotations

import base64
import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.tasks import Plotted, Saved
from modalmotion.classification.estimators.pool import Pool, pool_of
from modalmotion.classification.estimators.temperature import softmax
from modalmotion.classification.features import (
    Columns,
    FeatureReader,
    Further,
    KnownFeatures,
    MotionFeatures,
)
from modalmotion.classification.features.reader import PartKey, side_by_side
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.conformal import Calibration
from modalmotion.classification.model.cross_validation import CrossValidation
from modalmotion.classification.model.decision import Decision
from modalmotion.classification.model.domain import ARRAYS, Domain
from modalmotion.classification.model.member import Member
from modalmotion.modes.topology import CUP, CYLINDER, Topology
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature, SignatureKind, SignatureParameters


@shown()
@dataclass(frozen=True)
class Readable:
    """Which signatures a model reads.

    Parameters
    ----------
    topologies : tuple of str
        "mesh" for the spring modes of one mesh.
    n_modes : int
    connectivity_id : str
        Of that mesh; empty for modes in closed form.
    parameters : SignatureParameters
        Of the signatures; landmarks may differ, and so may the frame if the reference is one.
    """

    topologies: tuple[str, ...]
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
        """
        if surface in self.topologies or len(self.topologies) > 1:
            return None
        if stated is not None and not (self.closes_apices and surface == CYLINDER.name):
            return None
        return replace(self.parameters, topology=self.topologies[0])

    @property
    def closes_apices(self) -> bool:
        """Whether it takes cylinders as cups of which the apex was cut off.

        Of offsets on cups, which do not depend on where the surface ends.
        """
        is_offset = self.parameters.kind == SignatureKind.OFFSET
        return is_offset and self.topologies == (CUP.name,)


@shown("name", "classes", "readable.topologies", "readable.n_modes", "id")
@dataclass(frozen=True, eq=False)
class Model(FrozenArrays, Saved, Plotted):
    """A classifier of motions that is trained.

    Parameters
    ----------
    name : str
    classes : tuple of str
    readable : Readable
    members : tuple of Member
        Choices of features with their estimators, the weightiest first.
    temperature : float
        Probabilities are softmax(pooled logs of the members / temperature).
    domain : Domain
    calibration : Calibration
    golden_features : (cases, features) float64
    golden_probabilities : (cases, classes) float64
        Those that the model must give for them.
    notes : dict of str to tuple of str
        Notes for every answer (under "") or for one class.
    card : ModelCard
    cross_validation : CrossValidation or None
        Answers to the training cases, held out. Not part of the id: no answer depends on it.
    decision : Decision or None
        How probabilities become a label; None for the most probable class.
    """

    name: str
    classes: tuple[str, ...]
    readable: Readable
    members: tuple[Member, ...]
    temperature: float
    domain: Domain
    calibration: Calibration
    golden_features: NDArray[np.float64]
    golden_probabilities: NDArray[np.float64]
    notes: dict[str, tuple[str, ...]]
    card: ModelCard
    cross_validation: CrossValidation | None = None
    decision: Decision | None = None

    def __post_init__(self) -> None:
        self.golden_features.setflags(write=False)
        self.golden_probabilities.setflags(write=False)

    @cached_property
    def id(self) -> str:
        """Identity: sha256 in hex of everything that an answer depends on."""
        text = json.dumps(_identity(self), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def columns(self) -> Columns:
        """Features of all members, one after another."""
        return Columns(column for member in self.members for column in member.columns)

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """Features of an average training case, (features,) float64."""
        return np.concatenate([member.blend.centre for member in self.members])

    @cached_property
    def walls(self) -> bool:
        """Whether walls are told apart, so that the zero of theta must be known."""
        return any(member.reader.walls for member in self.members)

    @cached_property
    def has_axis(self) -> bool:
        """Whether parts about an axis are read."""
        return self.domain.reader.has_axis or any(m.reader.has_axis for m in self.members)

    @cached_property
    def reads_volume(self) -> bool:
        """Whether a volume must be enclosed."""
        volume = {Further.VOLUME, Further.VOLUME_CURVE}
        return any(volume & set(member.reader.further) for member in self.members)

    @cached_property
    def reads_motion(self) -> bool:
        """Whether a member reads the motion itself, and not only what is beside it."""
        return any(member.reader.reads_motion for member in self.members)

    @cached_property
    def no_motion_note(self) -> str:
        """What is read in the place of the motion, in words; empty where the motion is read."""
        if self.reads_motion:
            return ""
        kinds = dict.fromkeys(kind for member in self.members for kind in member.reader.further)
        *others, last = (f"the {kind}" for kind in kinds)
        what = f"{', '.join(others)} and {last}" if others else last
        return f"The model reads {what} alone, not the motion of the surface."

    def read(
        self,
        signature: ModalSignature,
        known: KnownFeatures | None = None,
    ) -> MotionFeatures:
        """Features of a signature, of all members, one row for each way to read it.

        What the domain has read of it, and members read too, is taken from `known`.
        """
        known = KnownFeatures() if known is None else known
        parts = [reader.part(key, signature, known) for key, reader in self._parts.items()]
        values = side_by_side(parts).take(self._places(tuple(p.shape[1] for p in parts)), axis=1)
        motion = self.members[0].reader.motion(signature, known)
        return MotionFeatures(self.columns, values, motion.motion, motion.smooth_share)

    @cached_property
    def _parts(self) -> dict[PartKey, FeatureReader]:
        """Parts that members read, each once, and a reader of each."""
        readers = [member.reader for member in self.members]
        return {key: reader for reader in reversed(readers) for key in reader.part_keys}

    def _places(self, widths: tuple[int, ...]) -> NDArray[np.int64]:
        """Columns of the parts, side by side, that are features of the members, one by one."""
        found = self._kept_places.get(widths)
        if found is None:
            ends = np.cumsum(widths)
            of = {
                key: np.arange(end - width, end)
                for key, width, end in zip(self._parts, widths, ends, strict=True)
            }
            keys = [key for member in self.members for key in member.reader.part_keys]
            found = np.concatenate([of[key] for key in keys])
            # All signatures that it reads give its parts the same widths.
            self._kept_places.clear()
            self._kept_places[widths] = found
        return found

    @cached_property
    def _kept_places(self) -> dict[tuple[int, ...], NDArray[np.int64]]:
        return {}

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Parameters of the signatures it reads."""
        return self.readable.parameters

    def log_shares(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log probabilities up to a constant, (cases, classes), of features (cases, features)."""
        if self._pool is None:
            return self.members[0].log_shares(features) / self.temperature
        return self._pool.log_shares(features) / self.temperature

    @cached_property
    def _pool(self) -> Pool | None:
        """All members side by side; None where one is a machine, which is alone."""
        if any(member.machine for member in self.members):
            return None
        return pool_of(
            [member.blend for member in self.members],
            [member.weight for member in self.members],
            [member.features for member in self.members],
        )

    def probabilities(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Probabilities, (cases, classes) float64, of features (cases, features)."""
        return softmax(self.log_shares(features))

    def label(self, probabilities: NDArray[np.float64]) -> str:
        """Label of one motion, of its probabilities (classes,)."""
        if self.decision is None:
            return self.classes[int(probabilities.argmax())]
        return self.classes[int(self.decision.labels(probabilities))]

    def distance(self, kinds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance to the nearest class, (cases,) float64, of `MotionFeatures.kinds`."""
        return self.domain.distance(kinds)


def _identity(model: Model) -> dict[str, Any]:
    """Everything of a model that an answer depends on, in the one form that is hashed."""
    domain = model.domain
    reader = _reader_identity(domain.reader)
    members = [_member_identity(member) for member in model.members]
    # Models of one choice that the domain reads, too, keep the ids that older versions gave.
    apart: dict[str, Any] = {}
    if len(members) > 1 or model.temperature != 1.0:
        apart = {
            "members": [
                {**values, "weight": member.weight}
                for values, member in zip(members, model.members, strict=True)
            ],
            "pool_temperature": model.temperature,
            "domain_reader": reader,
        }
    else:
        apart = (
            members[0]
            if reader == members[0]["reader"]
            else {**members[0], "domain_reader": reader}
        )
    return {
        **apart,
        "name": model.name,
        "classes": list(model.classes),
        "topologies": list(model.readable.topologies),
        "n_modes": model.readable.n_modes,
        "connectivity_id": model.readable.connectivity_id,
        "parameters": model.readable.parameters.as_plain(),
        "domain": {
            "means": _packed(domain.means),
            "whitening": _packed(domain.whitening),
            "limit": domain.limit,
            "least_motion": domain.least_motion,
            "least_smooth": domain.least_smooth,
            **_checks_identity(domain),
        },
        "calibration": [_packed(scores) for scores in model.calibration.scores],
        "golden_features": _packed(model.golden_features),
        "golden_probabilities": _packed(model.golden_probabilities),
        "notes": {label: list(texts) for label, texts in model.notes.items()},
        # Models without a rule of their own keep their ids.
        **({} if model.decision is None else {"decision": model.decision.as_json()}),
    }


def _member_identity(member: Member) -> dict[str, Any]:
    blend = member.blend
    return {
        "reader": _reader_identity(member.reader),
        "columns": [[c.name, list(c.modes), c.power] for c in member.columns],
        "centre": _packed(blend.centre),
        "scale": _packed(blend.scale),
        "scorers": [
            {
                "anchors": _packed(s.anchors),
                "gamma": s.gamma,
                "weights": _packed(s.weights),
                "intercepts": _packed(s.intercepts),
                "temperature": s.temperature,
            }
            for s in blend.scorers
        ],
        "temperature": blend.temperature,
        "machine": base64.b64encode(member.machine).decode(),
    }


def _reader_identity(reader: FeatureReader) -> dict[str, Any]:
    typical = reader.typical
    values: dict[str, Any] = {
        "has_axis": reader.has_axis,
        "is_cycle": reader.is_cycle,
        "n_harmonics": reader.n_harmonics,
        "walls": reader.walls,
        "typical": None if typical is None else _packed(np.stack([typical.real, typical.imag])),
        "adds_modes": reader.adds_modes,
        "is_brief": reader.is_brief,
    }
    # Left out at their defaults, which older versions had without a name.
    if reader.n_modes:
        values["n_modes"] = reader.n_modes
    if reader.patterns is not None:
        values["patterns"] = [_packed(array) for array in reader.patterns.arrays]
    if not reader.reads_motion:
        values["reads_motion"] = False
    if reader.further:
        values["further"] = list(reader.further)
        values["covariates"] = [
            [c.name, c.mean, list(c.words), c.may_be_missing] for c in reader.covariates
        ]
    return values


def _checks_identity(domain: Domain) -> dict[str, Any]:
    # Models of 0.1.0 check the kind of motion alone, and keep their ids.
    if not len(domain.points):
        return {}
    return {
        **{name: _packed(getattr(domain, name)) for name in ARRAYS[2:]},
        "has_unit": domain.has_unit,
        "hand_is_stated": domain.hand_is_stated,
        "hand_temperature": domain.hand_temperature,
    }


def _packed(array: NDArray[np.float64]) -> dict[str, Any]:
    """Array as little-endian float64 in base64, with its shape."""
    data = np.ascontiguousarray(array, dtype="<f8").tobytes()
    return {"shape": list(array.shape), "float64": base64.b64encode(data).decode()}
