"""The scene for MJX: the same bodies as for the C engine, with fewer collision pairs, and with prisms for cylinders.

MJX computes every pair whether near or not, so each object meets only the table nearest to it and the nearer of two
opposite walls, as stand-ins that follow the object, wherever the geometry proves that it cannot touch both. It has no
collisions of cylinders with boxes, so that each cylinder is a prism with SIDES sides and the cylinder's mass and inertia.
"""

from __future__ import annotations

import itertools
import math
import xml.etree.ElementTree as ElementTree

from bt_jax.mjx_env.scene.mjcf import FLOOR, build_mjcf, kit_geoms
from bt_jax.tasks import Object, Task

__all__ = ["StandIn", "stand_in_mjcf"]

CONTACTS_PER_BOX = 8
SIDES = 8
StandIn = tuple[int, tuple[tuple[float, float, float], ...], int | None]


def stand_in_mjcf(task: Task) -> tuple[str, list[StandIn]]:
    """Return the scene with explicit contact pairs, and its stand-ins: index of the object, places to choose from, index of
    the kit in whose frame these are, if any. Their bodies follow the kits' in the file and thus in the mocap arrays."""
    root = ElementTree.fromstring(build_mjcf(task))
    world, defaults = _only(root, "worldbody"), _only(root, "default/geom")
    _only(root, "option").remove(_only(root, "option/flag"))  # the C engine's resets, which Warp refuses to read about
    contact = ElementTree.SubElement(root, "contact")
    kits = [body for body in world.iter("body") if body.get("name") in task.kit_names]
    geoms = {geom.get("name"): geom for geom in world.iter("geom")}
    tables = tuple(table.name for table in task.tables)
    for thing in task.objects:
        if thing.shape == "cylinder":
            _make_prism(thing, _only(root, "asset"), _only(world, f"body[@name='{thing.name}']"))
    stand_ins: list[StandIn] = []
    insert = list(world).index(kits[-1]) + 1

    def stand_in(box: int, names: tuple[str, ...], kit: int | None = None) -> str:
        nonlocal insert
        name = f"near/{names[0]}/{box}"
        body = ElementTree.Element("body", name=name, mocap="true")
        ElementTree.SubElement(body, "geom", {"name": name, "type": "box", "size": geoms[names[0]].attrib["size"]})
        world.insert(insert, body)
        insert += 1
        places = tuple(_vector(geoms[name].attrib["pos"]) for name in names)
        stand_ins.append((box, places, kit))
        return name

    pairs = []
    for i, box in enumerate(task.objects):
        alone = _only_nearest_table(task, 2 * box.radius)
        pairs += [(FLOOR, box.name)]
        pairs += [(name, box.name) for name in ([stand_in(i, tables)] if alone else tables)]
        for k, kit in enumerate(task.kits):
            plate, left, right, front, back, *dividers = kit_geoms(kit)
            pairs += [(name, box.name) for name in (plate, *dividers)]
            for axis, both in enumerate(((left, right), (front, back))):
                single = box.radius < kit.inner[axis] / 2
                pairs += [(name, box.name) for name in ([stand_in(i, both, k)] if single else both)]
    pairs += list(itertools.combinations(task.object_names, 2))
    met = {name for pair in pairs for name in pair}
    for parent in (*kits, world):
        for geom in [geom for geom in parent.findall("geom") if geom.get("name") not in met]:
            parent.remove(geom)
    for geom in world.iter("geom"):  # only the explicit pairs meet
        geom.set("contype", "0")
        geom.set("conaffinity", "0")
    for first, second in pairs:
        attributes = {"geom1": first, "geom2": second, "friction": "1 1 .005 .0001 .0001", "condim": "3"}
        ElementTree.SubElement(
            contact, "pair", attributes | {key: defaults.attrib[key] for key in ("solref", "solimp")}
        )
    custom = ElementTree.SubElement(root, "custom")
    contacts = str(CONTACTS_PER_BOX * len(task.objects))
    ElementTree.SubElement(custom, "numeric", name="max_contact_points", data=contacts)
    return ElementTree.tostring(root, encoding="unicode"), stand_ins


def _make_prism(thing: Object, assets: ElementTree.Element, body: ElementTree.Element) -> None:
    """Make the geom of a cylinder a prism with as large a foot. Equal cylinders share a mesh, since MJX compiles the
    collisions of each two meshes by themselves."""
    radius, half = thing.size[0] / 2, thing.height / 2
    name = f"prism_{thing.size[0]:.7g}_{thing.height:.7g}"
    if assets.find(f"mesh[@name='{name}']") is None:
        angle = 2 * math.pi / SIDES
        reach = radius * math.sqrt(angle / math.sin(angle))
        corners = [
            (reach * math.cos(angle * i), reach * math.sin(angle * i), z) for i in range(SIDES) for z in (half, -half)
        ]
        vertices = " ".join(f"{value:.7g}" for corner in corners for value in corner)
        ElementTree.SubElement(assets, "mesh", name=name, vertex=vertices)
    geom = _only(body, "geom")
    for key in ("size", "friction", "condim", "density"):
        geom.attrib.pop(key)
    geom.attrib |= {"type": "mesh", "mesh": name, "mass": "0"}
    across = thing.mass * (3 * radius**2 + thing.height**2) / 12
    inertia = f"{across:.7g} {across:.7g} {thing.mass * radius**2 / 2:.7g}"
    ElementTree.SubElement(body, "inertial", pos="0 0 0", mass=f"{thing.mass:.7g}", diaginertia=inertia)


def _only(root: ElementTree.Element, path: str) -> ElementTree.Element:
    found = root.find(path)
    if found is None:
        raise ValueError(f"the scene has no {path}")
    return found


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = map(float, text.split())
    return x, y, z


def _only_nearest_table(task: Task, diagonal: float) -> bool:
    """Return whether an object can touch only the table whose centre is nearest: all are alike and lie further apart than
    the object's diagonal."""
    if len({(table.size, table.position[2]) for table in task.tables}) > 1:
        return False
    for a, b in itertools.combinations(task.tables, 2):
        gap = max(abs(p - q) - s for p, q, s in zip(a.position[:2], b.position[:2], a.size[:2], strict=True))
        if gap < diagonal:
            return False
    return True
