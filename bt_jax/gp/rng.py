"""Many random words at little cost, for decisions about trees.

JAX's own generator takes longer than a whole mutation, to compile and to run; mixed counters are as good for this.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int32, UInt32

__all__ = ["mix", "random_words", "shuffled"]


def mix(word: UInt32[Array, "*S"]) -> UInt32[Array, "*S"]:
    """Return a bijection of 32 bits in which each bit depends on all (the finalizer of MurmurHash3)."""
    word = (word ^ (word >> 16)) * jnp.uint32(0x85EBCA6B)
    word = (word ^ (word >> 13)) * jnp.uint32(0xC2B2AE35)
    return word ^ (word >> 16)


def random_words(key: Array, shape: tuple[int, int], step: int | Int32[Array, ""] = 0) -> UInt32[Array, "W P"]:
    """Words that depend on the key, the step and the place; different keys and steps are independent for our purposes."""
    low, high = jnp.split(jax.random.key_data(key).reshape(-1)[:2], 2)
    low, high = mix(low[0] + jnp.uint32(0x9E3779B9) * jnp.asarray(step).astype(jnp.uint32)), high[0]
    counter = jnp.arange(shape[0] * shape[1], dtype=jnp.uint32).reshape(shape)
    return mix(mix(counter * jnp.uint32(0x9E3779B9) ^ low) + high)


def shuffled(key: Array, count: int, step: int = 0) -> Int32[Array, " P"]:
    """Return the numbers from 0 to count - 1 in random order."""
    order = jnp.arange(count, dtype=jnp.int32)
    return jax.lax.sort((random_words(key, (1, count), step)[0], order), num_keys=1)[1]
