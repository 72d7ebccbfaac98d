"""XML of other programs: a tree of few elements, without entities."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from modalmotion.errors import InputError, LimitError, MalformedFileError

_DEEPEST = 20


def xml_tree(
    data: bytes,
    form: str,
    malformed: Callable[[str], MalformedFileError],
    most: int,
    *,
    has_type: bool = False,
) -> Element:
    """Parse XML that has no entities, nor a document type unless such files have it.

    Parameters
    ----------
    data : bytes
    form : str
        Name of the form, in messages.
    malformed : callable
        Makes the error.
    most : int
        Elements.
    has_type : bool
        Whether such files have a document type.

    Raises
    ------
    MalformedFileError
        Made by `malformed`, with the form in its message.
    LimitError
        If it has more elements, or more in one another than 20.
    """
    builder = TreeBuilder()
    n_elements = depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal n_elements, depth
        n_elements, depth = n_elements + 1, depth + 1
        for limit, value, at_most in (
            ("xml_elements", n_elements, most),
            ("xml_depth", depth, _DEEPEST),
        ):
            if value > at_most:
                raise LimitError(
                    f"The {form} file has more than {at_most} elements"
                    f"{' in one another' if limit == 'xml_depth' else ''}.",
                    remedy="Save the surface alone, without its arrays of data.",
                    limit=limit,
                    details={"most": at_most},
                )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise malformed(f"The {form} file contains a document type or entities.")

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = refuse
    if not has_type:
        parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except InputError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise malformed(f"The {form} file is not readable XML ({str(error)[:80]}).") from error
    return builder.close()
