"""Methods of values: the public functions of the same names, where tab completion finds them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from modalmotion import (
        Classification,
        ClinicalReadouts,
        Encoded,
        ModalSignature,
        Report,
        Strain,
    )


class Saved:
    """A value that `modalmotion.save` writes to a file."""

    def save(self, path: str | Path) -> Path:
        """Write it to a file, in the format that the end of its name says: see `modalmotion.save`.

        Raises
        ------
        ParameterError
            If there is no such format for it.
        """
        import modalmotion

        return modalmotion.save(self, path)


class Plotted:
    """A value that `modalmotion.plot` draws."""

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw it, and write the picture where a file is named: see `modalmotion.plot`.

        Returns
        -------
        matplotlib.figure.Figure
        """
        import modalmotion

        return modalmotion.plot(self, path)


class Recorded(Saved, Plotted):
    """A moving surface: a sequence or a track."""

    def signature(self: Any, *parameters: Any, **fields: Any) -> ModalSignature:
        """Fit modes, `signature(modes=7)`: see `modalmotion.modal_signature`."""
        import modalmotion

        return modalmotion.modal_signature(self, *parameters, **fields)

    def classify(self: Any, *arguments: Any, **options: Any) -> Classification:
        """Name the class of its motion: see `modalmotion.classify`."""
        import modalmotion

        return modalmotion.classify(self, *arguments, **options)

    def strain(self: Any, **options: Any) -> Strain:
        """Measure GLS, GCS and more: see `modalmotion.strain`."""
        import modalmotion

        return modalmotion.strain(self, **options)

    def readouts(self: Any, *parameters: Any, **fields: Any) -> ClinicalReadouts:
        """Read volume and ejection fraction, of its signature: see `clinical_readouts`."""
        import modalmotion

        return modalmotion.clinical_readouts(self.signature(*parameters, **fields), self)

    def encode(self: Any, **options: Any) -> Encoded:
        """Compress it, `encode()` or `encode(rms=0.3)`: see `modalmotion.encode`."""
        import modalmotion

        return modalmotion.encode(self, **options)

    def view(self: Any, **options: Any) -> Any:
        """Show it moving in a notebook: see `modalmotion.view`."""
        import modalmotion

        return modalmotion.view(self, **options)

    def report(self: Any, path: Any, **options: Any) -> Report:
        """Write a report, a folder or one file of it: see `modalmotion.report`."""
        import modalmotion

        return modalmotion.report(self, path, **options)
