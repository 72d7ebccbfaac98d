"""Features of signatures as a transformer of scikit-learn, which is imported here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted

from modalmotion.classification.features import (
    FeatureReader,
    has_axis,
    like_most,
    mean_motion,
    motion_of,
    nearest,
    right_handed,
)
from modalmotion.classification.options import Timing, TrainingOptions, Walls
from modalmotion.classification.tables.covariate_columns import (
    CovariateColumn,
    covariate_columns,
    covariate_values,
)
from modalmotion.classification.tables.recordings import (
    Recording,
    in_basis,
    in_one_basis,
    recordings_of,
)
from modalmotion.classification.training.case_row import zero_is_known
from modalmotion.errors import ParameterError
from modalmotion.signature.making import ModalSignature, SignatureParameters

KINDS: Final = ("auto", "axis", "summary", "modes", "terms")

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5

Array = NDArray[np.float64]


class SignatureFeatures(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Features of recordings, for a pipeline of scikit-learn.

    `fit` decides from all recordings in which modes they compare, whether they are cycles and
    which features are read; `transform` reads them. Labels play no part, so nothing leaks.

    Parameters
    ----------
    modes : int
        Of the signatures that sequences are fitted with.
    topology : str or None
        Of these signatures; "mesh" for spring modes. None lets the recordings decide together.
    kind : str
        "axis": parts about the axis of the motion; "modes": modes as they are; "summary": the
        same in few numbers; "terms": modes and their terms, turned onto the typical motion;
        "auto": "axis" where all have one over a cycle, else "modes".
    timing : str
        "cycle", "course" or "auto": cycles where most recordings close.
    harmonics : int
        Of each part of the motion.
    walls : str
        "yes", "no" or "auto": tell walls apart where every recording states the zero of theta.
    covariates : None, "all" or sequence of str
        Covariates that become columns: a number is one, NaN where it is unknown, and each word
        has one. Imputation and scaling are left to the pipeline.

    Attributes
    ----------
    readable_ : Readable
        Modes that the recordings share.
    reader_ : FeatureReader
    covariate_columns_ : tuple of CovariateColumn

    Notes
    -----
    Columns of one motion are the same however it is turned, moved, scaled in its unit, sampled
    and, as a cycle, started. Theta is taken to run right-handed about the axis, as it does on
    meshes; of the two sides that may be inward the one that is usual in `fit` is read.
    """

    def __init__(
        self,
        modes: int = 7,
        topology: str | None = None,
        kind: str = "auto",
        timing: str = "auto",
        harmonics: int = 2,
        walls: str = "auto",
        covariates: str | Sequence[str] | None = None,
    ) -> None:
        self.modes = modes
        self.topology = topology
        self.kind = kind
        self.timing = timing
        self.harmonics = harmonics
        self.walls = walls
        self.covariates = covariates

    def fit(self, X: Iterable[Any], y: Any = None) -> SignatureFeatures:
        """Decide which features are read.

        Parameters
        ----------
        X : sequence of ModalSignature, MeshSequence or TrainingCase
            Signatures are read as they are; sequences are fitted.
        y : ignored

        Raises
        ------
        ParameterError
            If there is no recording, an option has no such value, or the recordings have not
            the features that it names.
        UnlikeCasesError
            If their modes do not compare.
        """
        del y
        self._fit(recordings_of(X))
        return self

    def fit_transform(self, X: Iterable[Any], y: Any = None, **_: Any) -> Array:
        """Fit, and give the features of the same recordings: see `fit` and `transform`."""
        del y
        return self._table(self._fit(recordings_of(X)))

    def transform(self, X: Iterable[Any]) -> Array:
        """Read the features of recordings.

        Parameters
        ----------
        X : sequence of ModalSignature, MeshSequence or TrainingCase
            Sequences are fitted in the modes of `fit`.

        Returns
        -------
        (recordings, features) float64
            Shares of the surface's size, in percent, or of the motion; covariates as they are.

        Raises
        ------
        UnlikeCasesError
            If the modes of one do not compare with those of `fit`.
        """
        check_is_fitted(self)
        return self._table(in_basis(recordings_of(X), self.readable_))

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Names of the columns, (features,) object."""
        del input_features
        check_is_fitted(self)
        names = [*self._names, *(column.name for column in self.covariate_columns_)]
        return np.array(names, dtype=object)

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Parameters that sequences are fitted with, before their topologies are compared."""
        return self._options.signature_parameters

    @property
    def _options(self) -> TrainingOptions:
        return TrainingOptions(
            modes=self.modes,
            topology=self.topology,
            timing=self.timing,
            harmonics=self.harmonics,
            walls=self.walls,
        )

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.no_validation = True
        return tags

    def _fit(self, recordings: list[Recording]) -> list[ModalSignature]:
        if self.kind not in KINDS:
            raise ParameterError(
                f"The option 'kind' is {str(self.kind)[:80]!r}.",
                remedy=f"Use one of: {', '.join(KINDS)}.",
                details={"option": "kind"},
            )
        options = self._options
        if not recordings:
            raise ParameterError("There is no recording.", remedy="Give at least one.")
        may_have_axis = self.kind in ("auto", "axis") and options.timing != Timing.COURSE
        signatures, self.readable_ = in_one_basis(
            recordings, options.signature_parameters, mixes_axes=may_have_axis
        )
        reader = self._chosen(signatures, options)
        if reader.typical is not None:
            motions = [motion_of(signature, reader).terms for signature in signatures]
            reader = replace(reader, typical=mean_motion(motions, is_cycle=reader.is_cycle))
        self.reader_ = reader
        covariates = [signature.facts.covariates for signature in signatures]
        self.covariate_columns_: tuple[CovariateColumn, ...] = covariate_columns(
            covariates, self.covariates
        )
        read = [reader.read(signature) for signature in signatures]
        self._names = read[0].names
        _, self._centre, self._scale = like_most([right_handed(one.values) for one in read])
        return signatures

    def _chosen(self, signatures: list[ModalSignature], options: TrainingOptions) -> FeatureReader:
        gaps = [signature.closure_gap for signature in signatures]
        is_cycle = options.timing == Timing.CYCLE or (
            options.timing == Timing.AUTO and float(np.median(gaps)) < _CLOSED
        )
        no_axis = [k for k, signature in enumerate(signatures) if not has_axis(signature)]
        about_axis = is_cycle and not no_axis and self.kind in ("auto", "axis")
        if self.kind == "axis" and not about_axis:
            why = f"item {no_axis[0]} has no axis" if no_axis else "these are no cycles"
            raise ParameterError(
                f"Parts about an axis cannot be read: {why}.",
                remedy="Use kind='modes', or state timing='cycle' and a topology with an axis.",
                details={"option": "kind"},
            )
        reader = FeatureReader(about_axis, is_cycle, options.harmonics, self._walls(signatures))
        if self.kind == "summary":
            reader = replace(reader, is_brief=True)
        if self.kind == "terms":
            if reader.waves(signatures[0]).sines.max() >= 0:
                raise ParameterError(
                    "Terms mean nothing where theta may start anywhere.",
                    remedy="Use kind='modes', or walls='yes' where the landmark theta_zero is "
                    "stated.",
                    details={"option": "kind"},
                )
            terms = motion_of(signatures[0], reader).terms
            reader = replace(reader, typical=np.zeros_like(terms))
        return reader

    def _walls(self, signatures: list[ModalSignature]) -> bool:
        if self.walls == Walls.AUTO:
            landmarks = [signature.landmarks for signature in signatures]
            return all(one is not None and "theta_zero" in one.given for one in landmarks)
        unknown = [k for k, signature in enumerate(signatures) if not zero_is_known(signature)]
        if self.walls == Walls.YES and unknown:
            raise ParameterError(
                f"Walls are to be told apart, but theta has no zero in item {unknown[0]}.",
                remedy="State the landmark theta_zero, or leave the option 'walls' out.",
                details={"option": "walls", "case": unknown[0]},
            )
        return self.walls == Walls.YES

    def _table(self, signatures: list[ModalSignature]) -> Array:
        values = [self.reader_.read(signature).values for signature in signatures]
        chosen = [nearest(right_handed(own), self._centre, self._scale) for own in values]
        covariates = [signature.facts.covariates for signature in signatures]
        table = covariate_values(covariates, self.covariate_columns_)
        features = np.array(chosen).reshape(len(signatures), len(self._names))
        return np.concatenate([features, table], axis=1)
