"""What worker processes do. Tasks carry paths and small values, and may run twice.

Whatever parses an upload, or opens a file whose size a user chose, happens here and never in
the server's own process.
"""
