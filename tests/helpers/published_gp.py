"""The published genetic programming in plain Python: token lists, random draws, and redrawing until the tree is valid.

The baseline for speed and the oracle for behaviour of `bt_jax.gp`. A tree is a list of tokens in prefix order with END
after the children of each control node; leaves are numbered as in a vocabulary.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Container, Iterable

import numpy as np

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig

__all__ = ["PublishedGP", "from_trees", "to_trees"]

SEQUENCE, FALLBACK, END = 1, 2, -1
CONTROLS = (SEQUENCE, FALLBACK)
Genome = list[int]


class PublishedGP:
    """The operators over one alphabet; `random` is the only state."""

    def __init__(self, alphabet: Alphabet, config: GPConfig, seed: int = 0) -> None:
        self.alphabet, self.config, self.random = alphabet, config, random.Random(seed)
        self.leaves = range(3, alphabet.end)
        self.acts = range(alphabet.first_action, alphabet.end)

    def random_node(self) -> int:
        return self.random.choice(self.leaves) if self.random.random() < 0.5 else self.random.choice(CONTROLS)

    def random_tree(self, length: int) -> Genome:
        while True:
            genome, depth = [self.random.choice(CONTROLS)], 1
            for _ in range(length - 1):
                genome.append(self.random_node())
                if genome[-1] in CONTROLS:
                    depth += 1
                elif genome[-1] in self.acts:
                    genome.append(END)
                    depth -= 1
            genome += [END] * depth
            if self.is_valid(genome):
                return genome

    def is_valid(self, genome: Genome) -> bool:
        """The rules of `bt_jax.encoding.arrays.violations`; a control node with one child passes here."""
        alphabet = self.alphabet
        if not genome or genome[0] not in CONTROLS or subtree_end(genome, 0) != len(genome):
            return len(genome) == 1 and genome[0] in self.acts
        parents: list[int] = []
        for i, token in enumerate(genome):
            before = genome[i - 1] if i else None
            if token == END:
                if before in CONTROLS or (before != END and before < alphabet.first_action):
                    return False
                parents.pop()
                continue
            parent = parents[-1] if parents else None
            if token in CONTROLS:
                if token == parent:
                    return False
                parents.append(token)
            else:
                if token == before:
                    return False
                if token < alphabet.first_action and before in self.acts:
                    return False
                if token >= alphabet.first_gene and parent == FALLBACK and not self.config.gene_under_fallback:
                    return False
        return sum(token != END for token in genome) <= self.config.max_nodes

    def mutation_step(self, genome: Genome) -> Genome | None:
        """One mutation; None where 100 draws gave nothing valid and different."""
        for _ in range(100):
            result = tidy(self.draw_mutation(genome))
            if result != genome and self.is_valid(result):
                return result
        return None

    def draw_mutation(self, genome: Genome) -> Genome:
        choose = self.random.choice
        i = self.random.randrange(len(genome))
        edit, token = self.random.random(), genome[i]
        end = subtree_end(genome, i)
        if edit < self.config.p_delete:
            return genome if token == END else genome[:i] + genome[end:]
        node = self.random_node()
        if edit < self.config.p_delete + self.config.p_add:
            if node not in CONTROLS:
                return [*genome[:i], node, *genome[i:]]
            if i > 0:
                return [*genome[:i], node, choose(self.leaves), choose(self.acts), END, *genome[i:]]
            if self.random.random() < 0.5:
                return [node, choose(self.leaves), *genome, END]
            return [node, *genome, choose(self.acts), END]
        if token == END:
            return genome
        if node not in CONTROLS:
            return [*genome[:i], node, *genome[end:]]
        if token in CONTROLS:
            return [*genome[:i], node, *genome[i + 1 :]]
        children = [choose(self.leaves), token] if token in self.acts else [token, choose(self.acts)]
        return [*genome[:i], node, *children, END, *genome[i + 1 :]]

    def mutant(self, parent: Genome, known: Container[tuple[int, ...]]) -> Genome:
        """A chain of mutations, each new; a failure starts over from the parent. A new random tree after 100 failures:
        a first tree of control nodes with one child each may admit nothing."""
        for _ in range(100):
            genome: Genome | None = parent
            for _ in range(self.random.randint(1, self.config.max_mutations)):
                genome = self.mutation_step(genome)
                if genome is None or len(genome) < 2 or tuple(genome) in known:
                    break
            else:
                return genome
        while tuple(genome := self.random_tree(self.config.init_nodes)) in known:
            pass
        return genome

    def crossover(self, a: Genome, b: Genome, known: Container[tuple[int, ...]]) -> tuple[Genome, Genome]:
        """A random proper subtree of each, inserted at a random place of the other, drawn again until both are valid and
        new; mutants where 100 draws find none."""
        for _ in range(100):
            first, second = self.insert_subtree(a, b), self.insert_subtree(b, a)
            valid = first != second and self.is_valid(first) and self.is_valid(second)
            if valid and tuple(first) not in known and tuple(second) not in known:
                return first, second
        first = self.mutant(a, known)
        while (second := self.mutant(b, known)) == first:
            pass
        return first, second

    def insert_subtree(self, genome: Genome, donor: Genome) -> Genome:
        start = self.random.choice([i for i, token in enumerate(donor) if i and token != END])
        place = self.random.randrange(len(genome))
        return genome[:place] + donor[start : subtree_end(donor, start)] + genome[place:]

    def tournament(self, fitness: list[float], field: Iterable[int], num: int) -> list[int]:
        """Winners of a knock-out in the shuffled field with byes to num * 2^m."""
        field = list(field)
        self.random.shuffle(field)
        size = num
        while size < len(field):
            size *= 2
        level: list[int | None] = [None] * size
        for i, individual in enumerate(field):
            level[(i % num) * (size // num) + i // num] = individual
        while len(level) > num:
            pairs = zip(level[::2], level[1::2], strict=True)
            level = [a if b is None or (a is not None and fitness[a] >= fitness[b]) else b for a, b in pairs]
        return level

    def reproduce(self, population: list[Genome], fitness: list[float], *, hashed: bool = True) -> list[Genome]:
        """The offspring of one generation; known individuals are looked up in a set, or (not `hashed`) in a list."""
        config, offspring = self.config, []
        known = (set if hashed else list)(map(tuple, population))

        def keep(genome: Genome) -> None:
            offspring.append(genome)
            (known.add if hashed else known.append)(tuple(genome))

        parents = self.tournament(fitness, range(len(population)), config.num_mutation_parents)
        for parent in parents:
            for _ in range(config.mutation_offspring):
                keep(self.mutant(population[parent], known))
        parents = self.tournament(fitness, range(len(population)), config.num_crossover_parents)
        for _ in range(config.crossover_offspring):
            self.random.shuffle(parents)
            for a, b in zip(parents[::2], parents[1::2], strict=True):
                for genome in self.crossover(population[a], population[b], known):
                    keep(genome)
        return offspring

    def survivors(self, fitness: list[float], offspring_fitness: list[float]) -> list[int]:
        """Indices into the old population followed by the offspring."""
        together = fitness + offspring_fitness
        old = sorted(range(len(fitness)), key=lambda i: -fitness[i])[: self.config.num_old_survivors]
        pool = sorted([*old, *range(len(fitness), len(together))], key=lambda i: -together[i])
        elites, rest = pool[: self.config.num_elites], pool[self.config.num_elites :]
        return elites + self.tournament(together, rest, len(fitness) - len(elites))

    def evolve(self, evaluate: Callable[[Genome], float], generations: int) -> list[float]:
        """Best fitness of each generation."""
        population = [self.random_tree(self.config.init_nodes) for _ in range(self.config.population)]
        fitness = [evaluate(genome) for genome in population]
        best = [max(fitness)]
        for _ in range(generations):
            offspring = self.reproduce(population, fitness)
            offspring_fitness = [evaluate(genome) for genome in offspring]
            chosen = self.survivors(fitness, offspring_fitness)
            population, fitness = (
                [(old + new)[i] for i in chosen] for old, new in ((population, offspring), (fitness, offspring_fitness))
            )
            best.append(max(fitness))
        return best


def subtree_end(genome: Genome, start: int) -> int:
    """One past the last token of the subtree at `start`, its END included."""
    depth, i = 0, start
    while i < len(genome):
        depth += (genome[i] in CONTROLS) - (genome[i] == END)
        i += 1
        if depth <= 0:
            return i
    return -1


def tidy(genome: Genome) -> Genome:
    """From right to left, control nodes with one child or none dissolve, and so does a child of its parent's kind."""
    genome = list(genome)
    for i in reversed(range(len(genome))):
        if genome[i] not in CONTROLS:
            continue
        end = subtree_end(genome, i)
        if end < 0:
            return genome
        if i + 1 < end - 1 and subtree_end(genome, i + 1) != end - 1:
            continue
        inside = genome[i + 1 : end - 1]
        if inside and inside[0] in CONTROLS and parent_kind(genome, i) == inside[0]:
            inside = inside[1:-1]
        genome[i:end] = inside
    return genome


def parent_kind(genome: Genome, i: int) -> int | None:
    depth = 0
    for token in reversed(genome[:i]):
        depth += (token in CONTROLS) - (token == END)
        if depth == 1:
            return token
    return None


def to_trees(genomes: list[Genome], num_nodes: int) -> Trees:
    """The same trees as arrays."""
    tokens = np.zeros((len(genomes), num_nodes), np.int16)
    sizes = np.zeros((len(genomes), num_nodes), np.uint8)
    for row, genome in enumerate(genomes):
        nodes = [i for i, token in enumerate(genome) if token != END]
        for column, i in enumerate(nodes):
            tokens[row, column] = genome[i]
            sizes[row, column] = sum(token != END for token in genome[i : subtree_end(genome, i)])
    return Trees(tokens, sizes)


def from_trees(trees: Trees) -> list[Genome]:
    """Genomes of a batch of trees."""
    genomes = []
    for tokens, sizes in zip(np.asarray(trees.tokens).tolist(), np.asarray(trees.sizes).tolist(), strict=True):
        genome: Genome = []
        open_until: list[int] = []
        for i in range(sizes[0] + 1):
            while open_until and open_until[-1] == i:
                genome.append(END)
                open_until.pop()
            if i < sizes[0]:
                genome.append(tokens[i])
                if tokens[i] in CONTROLS:
                    open_until.append(i + sizes[i])
        genomes.append(genome)
    return genomes
