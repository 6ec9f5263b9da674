"""The former place of `testfield.seeds.normals_of_marks`."""

from testfield.seeds import normals_of_marks

__all__ = ["normals_of_marks"]
