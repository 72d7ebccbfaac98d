"""The codec: mesh sequences at an error you choose."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.codec.container import Header
from modalmotion.codec.decoder import decode, inspect
from modalmotion.codec.encoder import encode
from modalmotion.codec.frames import Effort
from modalmotion.codec.search import Encoded

__all__ = ["Effort", "Encoded", "Header", "decode", "encode", "inspect"]

check_arguments(globals())
