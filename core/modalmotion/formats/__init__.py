"""File formats of mesh sequences."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.formats.detect import Format as Format
    from modalmotion.formats.detect import detect_format as detect_format
    from modalmotion.formats.frame_files import write_ply_zip as write_ply_zip
    from modalmotion.formats.glb_writing import MorphAnimation as MorphAnimation
    from modalmotion.formats.glb_writing import write_glb as write_glb
    from modalmotion.formats.named_arrays import write_raw as write_raw
    from modalmotion.formats.npz import read_npz as read_npz
    from modalmotion.formats.npz import write_npz as write_npz
    from modalmotion.formats.parser_child import ParserHere as ParserHere
    from modalmotion.formats.parser_process import ParserProcess as ParserProcess
    from modalmotion.formats.reading import read_sequence as read_sequence
    from modalmotion.formats.result import Parser as Parser
    from modalmotion.formats.result import Reading as Reading
    from modalmotion.formats.result import ReadOptions as ReadOptions
    from modalmotion.formats.vtkhdf import write_vtkhdf as write_vtkhdf
    from modalmotion.limits import DEFAULT_LIMITS as DEFAULT_LIMITS
    from modalmotion.limits import NO_LIMITS as NO_LIMITS
    from modalmotion.limits import ReadLimits as ReadLimits
    from modalmotion.progress import Progress as Progress

__all__, __getattr__, __dir__ = public_list(globals())
