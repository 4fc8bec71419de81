// Objects and targets under the pointer: they are clicked, or dragged over what can carry them.
import { THREE } from "nicegui-scene";
import { poseOf, setPose } from "./shapes.js";
import { halfOf, supportHeight } from "./support.js";

const AXIS = new THREE.Vector3(0, 0, 1);
const CLICK = 4; // pixels by which a pointer may move in a click
const WARN = 0xd55e00;

// Methods of the component.
export const pointer = {
  hit(event, objects) {
    const { left, top, width, height } = this.$el.getBoundingClientRect();
    const x = ((event.clientX - left) / width) * 2 - 1;
    const y = 1 - ((event.clientY - top) / height) * 2;
    this.raycaster.setFromCamera(new THREE.Vector2(x, y), this.camera);
    return this.raycaster.intersectObjects(objects, true).find(({ object }) => object.isMesh);
  },

  handle(event) {
    const objects = this.model.objects.map(({ name }) => this.bodies[name]);
    const targets = Object.values(this.ghosts).filter((ghost) => ghost.userData.group === "targets");
    const found = this.hit(event, this.dragging === "targets" ? targets : objects);
    if (!found) return null;
    let object = found.object;
    while (object.parent !== this.scene) object = object.parent;
    return { object, point: found.point };
  },

  onDown(event) {
    if (event.button !== 0) return;
    this.pressed = this.handle(event);
    if (!this.pressed) return;
    this.pressed.from = [event.clientX, event.clientY];
    event.stopImmediatePropagation();
    event.target.setPointerCapture(event.pointerId);
  },

  onMove(event) {
    if (!this.pressed) return this.hover(event);
    const [x, y] = this.pressed.from;
    const far = Math.hypot(event.clientX - x, event.clientY - y) > CLICK;
    if (!this.drag && far && this.dragging) this.startDrag();
    if (this.drag) this.dragTo(event);
  },

  hover(event) {
    if (event.buttons) return;
    const found = this.handle(event);
    const text = found ? (found.object.userData.text ?? found.object.name) : "";
    event.target.style.cursor = found ? (this.dragging ? "grab" : "pointer") : "";
    this.tip.style.display = text ? "block" : "none";
    this.tip.textContent = text;
    const { left, top } = this.$el.getBoundingClientRect();
    this.tip.style.left = `${event.clientX - left + 14}px`;
    this.tip.style.top = `${event.clientY - top + 14}px`;
  },

  startDrag() {
    const { object, point } = this.pressed;
    const plane = new THREE.Plane(AXIS, -point.z);
    const offset = object.position.clone().sub(point);
    this.tip.style.display = "none";
    this.drag = { object, plane, offset, before: poseOf(object), half: halfOf(this.thingOf(object), object) };
  },

  dragTo(event) {
    const { object, plane, offset, half } = this.drag;
    this.hit(event, []);
    const point = this.raycaster.ray.intersectPlane(plane, new THREE.Vector3());
    if (!point) return;
    const [low, high] = this.model.room;
    const x = THREE.MathUtils.clamp(point.x + offset.x, low[0], high[0]);
    const y = THREE.MathUtils.clamp(point.y + offset.y, low[1], high[1]);
    const height = this.support(x, y, half);
    object.position.set(x, y, (height ?? this.model.top) + half[2]);
    this.warn(object, height === null);
    event.target.style.cursor = "grabbing";
    this.draw();
  },

  onUp(event) {
    const { pressed, drag } = this;
    this.pressed = this.drag = null;
    if (!pressed) return;
    event.target.style.cursor = "";
    if (!drag) {
      if (!this.dragging || this.dragging === "objects") this.$emit("pick", pressed.object.name);
      return;
    }
    this.warn(drag.object, false);
    this.dropped = drag.object;
    this.$emit("drop", { kind: this.dragging, name: drag.object.name, position: drag.object.position.toArray() });
    this.draw();
  },

  cancelDrag() {
    if (this.drag) {
      setPose(this.drag.object, this.drag.before);
      this.warn(this.drag.object, false);
      this.draw();
    }
    this.pressed = this.drag = null;
  },

  warn(object, bad) {
    object.traverse((part) => {
      if (!part.isLineSegments) return;
      part.userData.color ??= part.material.color.getHex();
      part.material.color.set(bad ? WARN : part.userData.color);
    });
  },

  // What a body or a translucent copy shows: its name, shape and size.
  thingOf(object) {
    return object.userData.thing ?? this.thing(object.name);
  },

  // Height of the highest thing that the dragged object would stand on there, null if that is the floor.
  support(x, y, half) {
    const parts = this.model.kits.flatMap(({ name, parts }) => {
      const kit = this.bodies[name].position;
      return parts.map((part) => ({ x: kit.x + part.x, y: kit.y + part.y, half: part.half, top: kit.z + part.top }));
    });
    const objects = this.model.objects.map(({ name }) => this.bodies[name]);
    const others = (this.dragging === "targets" ? Object.values(this.ghosts) : objects)
      .filter((other) => other !== this.drag.object)
      .map((other) => ({ object: other, thing: this.thingOf(other) }));
    return supportHeight(x, y, half, [...this.model.tables, ...parts], others);
  },
};
