"""The viewer in a notebook. Needs anywidget (extra ``notebook``)."""

from __future__ import annotations

from functools import cache
from typing import Any

from modalmotion.errors import ParameterError, needs_extra
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.template import Template
from modalmotion.tracking.result import Track
from modalmotion.viewer.bundle_files import script, style
from modalmotion.viewer.data_payload import data_payload
from modalmotion.viewer.page import View


def view(
    motion: MeshSequence | ModalSignature | Track,
    sequence: MeshSequence | None = None,
    *,
    parameters: SignatureParameters | None = None,
    template: Template | None = None,
) -> Any:
    """Show a moving surface beside its reconstruction in a notebook.

    Parameters
    ----------
    motion : MeshSequence, ModalSignature or Track
        Of a track the data are drawn over its surface.
    sequence : MeshSequence, optional
        The one that a signature was made from, which contains its surface.
    parameters : SignatureParameters, optional
        With which a sequence is fitted: 7 modes by default.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    anywidget.AnyWidget
        The same viewer as `modalmotion view` writes; it loads nothing.

    Raises
    ------
    ParameterError
        If a signature comes without its sequence, or with another.
    MissingExtraError
        If anywidget is not installed.
    """
    data = None
    if isinstance(motion, Track):
        data, motion = motion.data, motion.sequence
    if isinstance(motion, MeshSequence):
        sequence = motion
        signature = modal_signature(motion, parameters, template=template)
    elif sequence is None:
        raise ParameterError(
            "A signature contains amplitudes and no surface.",
            remedy="Give its sequence too: view(signature, sequence).",
        )
    else:
        signature = motion
    shown = View(signature, sequence, template=template)
    points = b"" if data is None else data_payload(data)
    return _widget()(payload=shown.payload(), frames=shown.pieces(), points=points)


@cache
def _widget() -> type:
    """Make the class of widgets, once."""
    with needs_extra("notebook"):
        import anywidget
        import traitlets

    class SurfaceWidget(anywidget.AnyWidget):  # type: ignore[misc]
        """A moving surface; payload and frames are what the page reads."""

        _esm = script()
        _css = style()
        payload = traitlets.Bytes().tag(sync=True)
        frames = traitlets.List(traitlets.Bytes()).tag(sync=True)
        points = traitlets.Bytes().tag(sync=True)

    return SurfaceWidget
