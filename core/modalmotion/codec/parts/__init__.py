"""Parts of a mesh that move as one."""
