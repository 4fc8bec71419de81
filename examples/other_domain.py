"""Evolve a Behavior Tree for a domain of your own: no boxes, no MuJoCo, only symbols and a fitness.

A rover on a straight track fetches samples from a site and brings them to its base, where it also charges; an empty battery
ends the mission. You say what the symbols mean (`statuses`, `act`) and how good a tree is (`fitness`); evolution asks for
the fitness of whole populations at once.
"""

import dataclasses

import jax
import jax.numpy as jnp

from bt_jax.behaviors import Kind, Symbol, Vocabulary
from bt_jax.encoding import Status, Trees, decode, draw_text, jump_table, tick_trees
from bt_jax.gp import Alphabet, Evolution, GPConfig, best_of

CONDITIONS = ["battery_low", "loaded"]
ACTIONS = ["drive_home", "drive_out", "charge", "dig", "unload"]
VOCABULARY = Vocabulary.of(
    [Symbol(name, Kind.CONDITION) for name in CONDITIONS] + [Symbol(name, Kind.ACTION) for name in ACTIONS]
)
SITE = 4  # metres from the base
FULL = 14  # charge; every action but charging takes 1
TICKS = 120


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Rover:
    """P rovers, one for each tree; every field is int[P]."""

    place: jax.Array
    battery: jax.Array
    load: jax.Array
    dug: jax.Array
    delivered: jax.Array


def statuses(rover: Rover) -> jax.Array:
    """Return the status of every token, int8[P, V]: an action is RUNNING while it can act."""
    home, out, alive = rover.place == 0, rover.place == SITE, rover.battery > 0
    meaning = {
        "battery_low": rover.battery <= SITE + 1,
        "loaded": rover.load == 1,
        "drive_home": ~home & alive,
        "drive_out": ~out & alive,
        "charge": home & (rover.battery < FULL),
        "dig": out & (rover.load == 0) & alive,
        "unload": home & (rover.load == 1) & alive,
    }
    columns = [jnp.zeros_like(home)] * 3  # padding, Sequence and Fallback have no status
    columns += [meaning[leaf.name] for leaf in VOCABULARY.leaves]
    running = jnp.asarray(VOCABULARY.kinds == Kind.ACTION)
    true = jnp.where(running, jnp.int8(Status.RUNNING), jnp.int8(Status.SUCCESS))
    return jnp.where(jnp.stack(columns, axis=1), true, jnp.int8(Status.FAILURE))


def act(rover: Rover, token: jax.Array) -> Rover:
    """Return the rovers after the action with that token, int[P]; 0 does nothing."""
    does = {leaf.name: token == VOCABULARY.token(leaf) for leaf in VOCABULARY.leaves}
    used = (token > 0).astype(jnp.int32)
    return Rover(
        place=rover.place + does["drive_out"] - does["drive_home"],
        battery=jnp.where(does["charge"], FULL, rover.battery - used),
        load=jnp.where(does["dig"], 1, jnp.where(does["unload"], 0, rover.load)),
        dug=rover.dug + does["dig"],
        delivered=rover.delivered + does["unload"],
    )


@jax.jit
def fitness(trees: Trees) -> jax.Array:
    """Return the fitness of trees [R, P, N]: samples delivered, a little for those that were dug, less a little a node."""
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, leaf.shape[-1]), trees)
    table, rows = jump_table(flat), jnp.arange(flat.tokens.shape[0])

    def one_tick(rover: Rover, _: None) -> tuple[Rover, None]:
        known = statuses(rover)
        ticked = tick_trees(table, lambda token: known[rows, token])
        node = jnp.minimum(ticked.leaf, flat.num_nodes - 1)
        token = jnp.where(ticked.status == Status.RUNNING, flat.tokens[rows, node].astype(jnp.int32), 0)
        return act(rover, token), None

    nothing = jnp.zeros(flat.tokens.shape[0], jnp.int32)
    rover, _ = jax.lax.scan(one_tick, Rover(nothing, nothing + FULL, nothing, nothing, nothing), None, length=TICKS)
    delivered, dug, nodes = (x.astype(jnp.float32) for x in (rover.delivered, rover.dug, flat.sizes[:, 0]))
    score = delivered + 0.2 * dug - 0.01 * nodes
    return score.reshape(trees.tokens.shape[:2])


def main(population: int = 200, generations: int = 30) -> float:
    """Evolve, print the best tree, and return its fitness."""
    config = GPConfig(population=population, generations=generations, max_nodes=24)
    evolution = Evolution(config, Alphabet.of(VOCABULARY))
    state = None
    for _ in range(1 + generations):
        offspring = evolution.ask(state)
        state = evolution.tell(state, offspring, jax.device_get(fitness(offspring)))
        if state.generation % 5 == 0:
            print(f"generation {state.generation:3d}  best {best_of(state)[1][0]:6.2f}")
    trees, best = best_of(state)
    print(draw_text(decode(trees[0], VOCABULARY)))
    return float(best[0])


if __name__ == "__main__":
    main()
