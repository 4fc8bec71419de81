"""A task with a bit of everything: a cube, a cuboid, a can, interchangeable bolts with one to spare, and two trays."""

from bt_jax.tasks import load_task, task_from_dict

TRAYS = task_from_dict(
    {
        "name": "trays",
        "description": "A plate and a can in slots, bolts in any of their slots, a cube on the plate.",
        "tables": load_task("stack").to_dict()["tables"],
        "objects": [
            {"name": "Cube", "size": 0.06, "color": [0.9, 0.7, 0.1]},
            {"name": "Plate", "size": [0.16, 0.08, 0.02], "color": [0.2, 0.6, 0.3]},
            {"name": "Can", "radius": 0.03, "height": 0.1, "color": [0.2, 0.4, 0.8]},
            {"part": "Bolt", "count": 3, "radius": 0.015, "height": 0.06, "color": [0.5, 0.5, 0.55]},
        ],
        "kits": [
            {
                "name": "TrayA",
                "size": [0.5, 0.3],
                "position": [0, 0.15],
                "slots": [
                    {"name": "a1", "position": [-0.15, 0], "turn": 90, "takes": "Plate"},
                    {"name": "a2", "position": [0.15, 0]},
                ],
            },
            {"name": "TrayB", "size": [0.3, 0.2], "position": [0, -0.2], "grid": [2, 3], "dividers": True},
        ],
        "layout": {"kit": "TableMiddle", "spacing": 0.2, "margin": 0.12},
        "targets": [
            {"object": "Plate", "slot": "TrayA.a1"},
            {"object": "Can", "slot": "TrayA.a2"},
            {"object": "Cube", "position": [0, 0, 0.04], "frame": "Plate"},
            {"object": "Bolt", "slot": "TrayB.r1c1"},
            {"object": "Bolt", "slot": "TrayB.r2c3"},
        ],
    },
    source="trays",
)
