"""Random numbers by name: adding a stage changes no other stage's numbers."""

import hashlib

import numpy as np


def seed_of(seed: int, name: str) -> int:
    """A 64-bit seed for the purpose `name`, from the scene's seed."""
    return int.from_bytes(hashlib.sha256(f"{seed}/{name}".encode()).digest()[:8], "little")


def generator(seed: int, name: str) -> np.random.Generator:
    """The generator of one purpose of one scene."""
    return np.random.default_rng(seed_of(seed, name))
