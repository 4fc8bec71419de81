// A person's hand in a demonstration: the object follows the pointer with the gripper, on top of what is under the pointer; the
// wheel, the keys Q and E, or a tap of a second finger turn it.
import { THREE } from "nicegui-scene";

const AXIS = new THREE.Vector3(0, 0, 1);
const TURN = THREE.MathUtils.degToRad(15); // as in bt_jax/app/state/directions.py
const NEAR = 0.01; // part of it by which a round angle may be missed
const PAUSE = 80; // milliseconds between two turns: a touchpad sends many events of a wheel
const FLUSH = 0.25; // in sizes of the object: what is this near to a flush face is moved there

// Methods of the component.
export const hand = {
  carries() {
    return this.drag && this.dragging === "hand";
  },

  // Where the middle of the dragged object goes: on the object that is pointed at or, without one, along with the pointer.
  aim(event) {
    const { object: dragged, plane, offset, half } = this.drag;
    if (this.dragging === "hand") {
      const found = this.handle(event, dragged);
      if (found) {
        const isLarge = this.halfOf(found.object).some((edge, axis) => axis < 2 && edge > 2 * half[axis]);
        return isLarge ? found.point : found.object.position;
      }
    }
    this.hit(event, []);
    return this.raycaster.ray.intersectPlane(plane, new THREE.Vector3())?.add(offset);
  },

  // On an object, faces that are nearly flush become flush, and what is nearly in the middle comes there.
  flush(at, half, under) {
    return [0, 1].map((axis) => {
      const room = Math.abs(under.half[axis] - half[axis]);
      const away = at[axis] - under.middle[axis];
      const best = [0, room, -room].find((place) => Math.abs(away - place) < 2 * FLUSH * half[axis]);
      return best === undefined ? at[axis] : under.middle[axis] + best;
    });
  },

  // The gripper comes along, with its fingers at the narrow sides.
  grasp() {
    const { object, half } = this.drag;
    const { x, y, z } = object.position;
    const narrow = half[0] <= half[1] ? 0 : 1;
    this.placeGripper([x, y, z, 2 * half[narrow], (narrow * Math.PI) / 2]);
  },

  // Turns the object to its next round angle, counter-clockwise with 1.
  turnBy(way) {
    const { object, event } = this.drag;
    const { x, y, z, w } = object.quaternion;
    const now = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
    const by = way * TURN * (Math.floor((way * now) / TURN + NEAR) + 1) - now;
    object.rotateOnWorldAxis(AXIS, by);
    this.drag.turned += THREE.MathUtils.radToDeg(by);
    this.drag.half = this.halfOf(object);
    this.dragTo(event);
  },

  onWheel(event) {
    if (!this.carries()) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.timeStamp - (this.drag.wheeled ?? 0) < PAUSE) return;
    this.drag.wheeled = event.timeStamp;
    this.turnBy(event.deltaY > 0 ? -1 : 1);
  },

  // While it is dragged, no other key reaches the gripper.
  onHandKey(event) {
    if (!this.carries() || event.key === "Escape") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const way = { q: 1, e: -1 }[event.key.toLowerCase()];
    if (way) this.turnBy(way);
  },
};
