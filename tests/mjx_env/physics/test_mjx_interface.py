"""What `bt_jax.mjx_env.physics` reads of MJX without MJX promising it. If one of these tests fails after an upgrade of
mujoco-mjx, what the message names has to follow, or pyproject.toml to lower its bound."""

import jax
import mujoco
import pytest
from mujoco import mjx

from bt_jax.mjx_env.physics.mjx_scene import stand_in_mjcf
from bt_jax.tasks import load_task

XML = """<mujoco><option cone="pyramidal"/><worldbody>
<geom name="floor" type="plane" size="0 0 1"/>
<body pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>"""
CONTACTS, DOFS = 4, 6  # of a box on a plane
ROWS = 4 * CONTACTS  # edges of the friction pyramids


@pytest.fixture(scope="module")
def data():
    """Shapes after the stages of `mjx.step` that are called one by one; nothing is compiled."""
    model = mjx.put_model(mujoco.MjModel.from_xml_string(XML), impl="jax")

    def stages(data):
        data = mjx.collision(model, mjx.com_pos(model, mjx.kinematics(model, data)))
        data = data.tree_replace({"_impl.contact": data._impl.contact})
        return mjx.make_constraint(model, mjx.factor_m(model, mjx.crb(model, data)))

    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        return jax.eval_shape(stages, mjx.make_data(model, impl="jax"))


@pytest.mark.parametrize(("name", "shape"), [("efc_J", (ROWS, DOFS)), ("efc_D", (ROWS,)), ("efc_aref", (ROWS,))])
def test_constraints_lie_in_impl(data, name, shape):
    assert hasattr(data._impl, name), f"MJX keeps {name} elsewhere: see `_advance` in physics/mjx_model.py"
    assert getattr(data._impl, name).shape == shape, f"{name} has another layout: see `solve` in physics/newton.py"


@pytest.mark.parametrize(
    ("name", "shape"),
    [("geom", (CONTACTS, 2)), ("frame", (CONTACTS, 3, 3)), ("pos", (CONTACTS, 3)), ("dist", (CONTACTS,))],
)
def test_contacts_lie_in_impl(data, name, shape):
    assert hasattr(data._impl.contact, name), f"MJX keeps contact.{name} elsewhere: see `Contacts` in mjx_contacts.py"
    assert getattr(data._impl.contact, name).shape == shape, f"contact.{name} has another layout: see `Contacts`"


def test_meshes_have_edges_to_take_away():
    model = mujoco.MjModel.from_xml_string(stand_in_mjcf(load_task("kit4"))[0])
    placed = mjx.put_model(model, impl="jax")
    found = [mesh for mesh in placed._impl.mesh_convex if mesh is not None]
    assert found, "MJX keeps meshes elsewhere: see `without_edges` in physics/mjx_contacts.py"
    assert all(mesh.edge.shape[1:] == (2,) and mesh.edge_face_normal.shape[1:] == (2, 3) for mesh in found)


def test_the_scene_disables_nothing_since_warp_refuses_some_flags():
    xml, _ = stand_in_mjcf(load_task("stack3"))
    assert mujoco.MjModel.from_xml_string(xml).opt.disableflags == 0
