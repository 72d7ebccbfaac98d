"""Compressed streams."""

from __future__ import annotations

from modalmotion.client.answers import CompressedSequence, compressed_of
from modalmotion.client.bodies import Source, body_of
from modalmotion.client.calls import NPZ, STREAM, Calls, sequence_of, sequence_path
from modalmotion.client.connection import Call
from modalmotion.client.query import Option
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress


class CodecCalls(Calls):
    """Compressed streams."""

    def encode(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> CompressedSequence:
        """Compress a sequence at an error you choose; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            One of rms, max_error (length unit of the sequence) and bytes; effort; and how to
            read the file.
        """
        call = Call("POST", "/v1/encode", options, STREAM, body_of(source), is_repeatable=True)
        return self._sent(call, compressed_of, progress)

    def encoded(self, sequence_id: str, **options: Option) -> CompressedSequence:
        """Return a stored sequence as a compressed stream: rms, max_error or bytes; effort."""
        call = Call("GET", sequence_path(sequence_id, "encoded"), options, STREAM)
        return self._awaited(call, compressed_of)

    def decode(
        self,
        source: Source,
        *,
        frames: range | None = None,
        vertices: range | None = None,
        progress: Progress | None = None,
    ) -> MeshSequence:
        """Decode a stream.

        Parameters
        ----------
        source : path or bytes
        frames : range, optional
            Without gaps; all frames by default.
        vertices : range, optional
            Without gaps; all vertices by default, else those with the triangles between them.
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        """
        ends = {} if frames is None else {"first": frames.start, "stop": frames.stop}
        if vertices is not None:
            ends |= {"first_vertex": vertices.start, "stop_vertex": vertices.stop}
        call = Call("POST", "/v1/decode", ends, NPZ, body_of(source), is_repeatable=True)
        return self._sent(call, sequence_of, progress)
