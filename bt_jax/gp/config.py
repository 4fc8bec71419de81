"""Settings of the evolution; where the paper's table I gives a number, it is the default."""

from __future__ import annotations

import dataclasses
import enum
import types
from collections.abc import Mapping
from typing import Literal

from bt_jax._util.errors import UserError
from bt_jax.encoding.limits import MAX_NODES

__all__ = ["GPConfig", "Method", "MutationConfig", "Selection"]


Method = Literal["achievements", "population"]  # see `bt_jax.gp.search` and `bt_jax.gp.evolution`
GENERATIONS: Mapping[Method, int] = types.MappingProxyType({"achievements": 1000, "population": 50})  # unless given
PATIENCE = 10  # unless given

SETTINGS_OF: Mapping[Method, tuple[str, ...]] = types.MappingProxyType(
    {
        "population": (
            "mutation_parents",
            "mutation_offspring",
            "crossover_parents",
            "crossover_offspring",
            "crossover_swap",
            "parent_selection",
            "survivor_selection",
            "elites",
            "old_share",
            "niches",
            "baseline_keep",
            "baseline_boost",
            "baseline_index",
        ),
        "achievements": ("patience", "accept_baseline"),
    }
)  # that the other method does not take


class Selection(enum.StrEnum):
    """How parents and survivors are chosen; see `bt_jax.gp.selection`."""

    TOURNAMENT = "tournament"
    RANK = "rank"
    ADJUSTABLE_RANK = "adjustable_rank"
    ELITISM = "elitism"
    RANDOM = "random"
    ALL = "all"


@dataclasses.dataclass(frozen=True)
class MutationConfig:
    """What one mutation may do. The three probabilities sum to 1; `max_steps` bounds a chain of mutations."""

    add: float = 0.1
    delete: float = 0.5
    change: float = 0.4
    max_steps: int = 3
    chain_ratio: float = 0.5
    gene_under_fallback: bool = False


@dataclasses.dataclass(frozen=True)
class GPConfig:
    """How trees evolve. Where the paper's table I gives a number, it is the default; method, old_share and chain_ratio,
    which are not in it, differ from the published runs."""

    # Hashable, since it is a static argument of jit.

    method: Method = "achievements"
    """achievements: learn which behavior achieves which target, and in which order behaviors work; population: the best of a
    generation breed the next, as published"""
    population: int = 16
    """individuals, 8 to 100000; with the method achievements, the trees measured in each generation"""
    generations: int | None = None
    """generations to evolve; auto: until every run has solved the task and no longer improves, 1000 at most; 50 with the
    method population"""
    runs: int = 1
    """independent runs side by side; run r is the single run of seed + r"""
    seed: int = 0
    """seed of everything random"""
    patience: int | None = None
    """of the method achievements: stop once every run has solved the task and has not improved for this many generations;
    auto: 10, 20 where things go wrong, and never if the number of generations is given"""
    accept_baseline: bool = False
    """of the method achievements: keep the baseline, or the plan, as it is and stop before anything is bred if it solves the
    task in 30 more layouts; not if the number of generations is given"""
    mutation_parents: int | None = None
    """parents selected for mutation; auto: 3/4 of the population, 12 of 16"""
    mutation_offspring: int = 2
    """offspring of each of them"""
    max_mutations: int = 3
    """longest chain of mutations that makes one offspring"""
    chain_ratio: float = 0.5
    """how likely a chain of mutations is, against one that is one shorter (published runs: 1)"""
    p_add: float = 0.1
    """probability that a mutation adds a node"""
    p_delete: float = 0.5
    """probability that it deletes a subtree"""
    p_change: float = 0.4
    """probability that it changes a node"""
    crossover_parents: int | None = None
    """parents selected for crossover, an even number; auto: 1/4 of the population, 4 of 16"""
    crossover_offspring: int = 2
    """offspring of each of them"""
    crossover_swap: bool = False
    """exchange the two subtrees instead of inserting each into the other parent"""
    parent_selection: Selection = Selection.TOURNAMENT
    """how parents are selected"""
    survivor_selection: Selection = Selection.TOURNAMENT
    """how survivors are selected"""
    elites: int | None = None
    """best individuals that always survive; auto: 1/10 of the population, 2 of 16"""
    old_share: float = 1.0
    """share of the old population, the best, that competes with the offspring for survival (published runs: 0.1)"""
    niches: bool = False
    """share the places among parents and survivors evenly among niches: trees of one size that achieve the same targets and
    subgoals (keep max_nodes small)"""
    init_nodes: int = 4
    """nodes of the first, random trees"""
    max_nodes: int = 64
    """nodes that a tree may have; fixes the length of its arrays"""
    gene_under_fallback: bool = False
    """whether a gene, itself a Fallback, may be a direct child of a Fallback"""
    baseline_keep: bool = True
    """keep the baseline available for crossover when the population has lost it"""
    baseline_boost: bool = True
    """count the baseline as the best when parents of crossover are selected"""
    baseline_index: int | None = None
    """insert from the baseline only as this child of the other parent's root, counted from 0; auto: anywhere"""

    @property
    def mutation(self) -> MutationConfig:
        return MutationConfig(
            self.p_add, self.p_delete, self.p_change, self.max_mutations, self.chain_ratio, self.gene_under_fallback
        )

    @property
    def num_generations(self) -> int:
        return GENERATIONS[self.method] if self.generations is None else self.generations

    @property
    def num_patience(self) -> int | None:
        """After how many generations without improvement a solved run ends; None if it does not."""
        return PATIENCE if self.patience is None and self.generations is None else self.patience

    @property
    def num_mutation_parents(self) -> int:
        return round(0.75 * self.population) if self.mutation_parents is None else self.mutation_parents

    @property
    def num_crossover_parents(self) -> int:
        return 2 * round(self.population / 8) if self.crossover_parents is None else self.crossover_parents

    @property
    def num_offspring(self) -> int:
        """M, the offspring of one generation; first those by mutation, then those by crossover."""
        return (
            self.num_mutation_parents * self.mutation_offspring + self.num_crossover_parents * self.crossover_offspring
        )

    @property
    def num_elites(self) -> int:
        return max(1, round(0.1 * self.population)) if self.elites is None else self.elites

    @property
    def num_old_survivors(self) -> int:
        """How many of the old population, the best, compete with the offspring for survival."""
        return max(1, round(self.old_share * self.population))

    def check(self) -> None:
        """Raise UserError for the first setting that cannot work."""
        if not 8 <= self.population <= 100_000:
            raise UserError(f"population is {self.population}; choose 8 to 100000")
        for name in ("p_add", "p_delete", "p_change"):
            if not 0 <= getattr(self, name) <= 1:
                raise UserError(f"{name} is {getattr(self, name)}; choose a probability from 0 to 1")
        total = self.p_add + self.p_delete + self.p_change
        if abs(total - 1) > 1e-6:
            raise UserError(f"p_add, p_delete and p_change sum to {total:g}; make them sum to 1")
        for name in ("num_mutation_parents", "num_crossover_parents"):
            if not 0 <= getattr(self, name) <= self.population:
                option = name.removeprefix("num_")
                raise UserError(f"{option} is {getattr(self, name)}; choose 0 to the population, {self.population}")
        if self.num_crossover_parents % 2:
            raise UserError(
                f"crossover_parents is {self.num_crossover_parents} and parents pair up; choose an even number"
            )
        for name in (
            "max_mutations",
            "mutation_offspring",
            "crossover_offspring",
            "num_generations",
            "runs",
            "num_patience",
        ):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise UserError(f"{name.removeprefix('num_')} is {value}; choose 1 or more")
        if not 0 <= self.seed <= (1 << 32) - max(self.runs, 1):
            raise UserError(f"seed is {self.seed}; choose 0 or more, below 2^32")
        if not 3 <= self.init_nodes <= self.max_nodes <= MAX_NODES:
            raise UserError(
                f"init_nodes is {self.init_nodes} and max_nodes {self.max_nodes}; choose 3 <= init_nodes <= max_nodes <= "
                f"{MAX_NODES}"
            )
        if not 0 < self.chain_ratio <= 1:
            raise UserError(f"chain_ratio is {self.chain_ratio}; choose above 0, up to 1")
        if not 0 <= self.old_share <= 1:
            raise UserError(f"old_share is {self.old_share}; choose 0 to 1")
        if not 0 <= self.num_elites <= self.population:
            raise UserError(f"elites is {self.num_elites}; choose 0 to the population, {self.population}")
        if self.num_old_survivors + self.num_offspring < self.population:
            raise UserError(
                f"{self.num_offspring} offspring cannot replace a population of {self.population}; raise mutation_parents"
            )
        if self.baseline_index is not None and not 0 <= self.baseline_index < self.max_nodes:
            raise UserError(f"baseline_index is {self.baseline_index}; choose a child of the root, counted from 0")
        self._check_method()
        if self.baseline_index is not None and self.crossover_swap:
            raise UserError("baseline_index inserts and crossover_swap exchanges; choose one of them")

    def _check_method(self) -> None:
        """Raise UserError for settings of another method than the chosen one."""
        defaults = {field.name: field.default for field in dataclasses.fields(self)}
        for method, names in SETTINGS_OF.items():
            given = [name for name in names if getattr(self, name) != defaults[name]]
            if method != self.method and given:
                options, verb = " and ".join(given), "is a setting" if len(given) == 1 else "are settings"
                raise UserError(
                    f"{options} {verb} of the method {method}, and the method is {self.method}; choose --method {method}, "
                    "or leave out what the other does not take"
                )
