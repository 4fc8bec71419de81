// Objects and targets under the pointer: they are clicked, or dragged over what can carry them.
import { THREE } from "nicegui-scene";
import { discard, ghostOf, poseOf, setPose } from "./shapes.js";
import { halfOf, supportUnder } from "./support.js";

const AXIS = new THREE.Vector3(0, 0, 1);
const CLICK = 4; // pixels by which a pointer may move in a click
const WARN = 0xd55e00;
const FINGER = 14; // pixels by which a finger may miss a thing
const FINE = 0.02; // metres: what is smaller moves in steps of a millimetre, all else in steps of five

// Methods of the component.
export const pointer = {
  hit(event, objects, [right, down] = [0, 0]) {
    const { left, top, width, height } = this.$el.getBoundingClientRect();
    const x = ((event.clientX + right - left) / width) * 2 - 1;
    const y = 1 - ((event.clientY + down - top) / height) * 2;
    this.raycaster.setFromCamera(new THREE.Vector2(x, y), this.camera);
    return this.raycaster.intersectObjects(objects, true).find(({ object }) => object.isMesh);
  },

  // What is under the pointer, or close to a finger, besides what is left `out`.
  handle(event, out = null) {
    const objects = this.model.objects.map(({ name }) => this.bodies[name]).filter((object) => object !== out);
    const also = this.dragging === "targets" ? this.targets() : this.dragging === "things" ? this.kits() : [];
    const isFinger = event.pointerType === "touch" && !this.drag;
    const around = isFinger ? [[0, 0], [FINGER, 0], [0, FINGER], [-FINGER, 0], [0, -FINGER]] : [[0, 0]];
    let found = null;
    for (const aside of around) found ??= this.hit(event, [...objects, ...also], aside);
    if (!found) return null;
    let object = found.object;
    while (object.parent !== this.scene) object = object.parent;
    return { object, point: found.point };
  },

  targets() {
    return Object.values(this.ghosts).filter((ghost) => ghost.userData.group === "targets");
  },

  kits() {
    return this.model.kits.map(({ name }) => this.bodies[name]);
  },

  onDown(event) {
    if (event.button !== 0) return;
    if (!event.isPrimary && this.pressed) {
      event.stopImmediatePropagation();
      if (this.carries()) this.turnBy(1);
      return;
    }
    this.pressed = this.handle(event);
    if (!this.pressed) return;
    this.pressed.from = [event.clientX, event.clientY];
    event.stopImmediatePropagation();
    event.target.setPointerCapture(event.pointerId);
  },

  onMove(event) {
    if (this.pressed && !event.isPrimary) return;
    if (!this.pressed) return this.hover(event);
    const [x, y] = this.pressed.from;
    const far = Math.hypot(event.clientX - x, event.clientY - y) > CLICK;
    if (!this.drag && far && this.dragging) this.startDrag();
    if (this.drag) this.dragTo(event);
  },

  hover(event) {
    if (event.buttons) return;
    const found = this.handle(event);
    event.target.style.cursor = found ? (this.dragging ? "grab" : "pointer") : "";
    this.tell(event, found ? (found.object.userData.text ?? found.object.name) : "");
  },

  // Shows a text beside the pointer.
  tell(event, text) {
    this.tip.style.display = text ? "block" : "none";
    this.tip.textContent = text;
    const { left, top, width } = this.$el.getBoundingClientRect();
    this.tip.style.left = `${Math.max(0, Math.min(event.clientX - left + 14, width - this.tip.offsetWidth))}px`;
    this.tip.style.top = `${event.clientY - top + 14}px`;
  },

  startDrag() {
    const { object, point } = this.pressed;
    const taken = this.dragging === "targets" ? this.targetOf(object) : object;
    const half = this.halfOf(taken);
    const isLifted = this.dragging === "hand" && object.position.z > this.model.top + 2 * half[2];
    const plane = new THREE.Plane(AXIS, -(isLifted ? this.model.top + half[2] : point.z));
    const offset = isLifted ? new THREE.Vector3() : object.position.clone().sub(point);
    this.drag = { object: taken, plane, offset, before: poseOf(taken), half, turned: 0 };
  },

  // The target that is meant by a target or by an object; an object without one gets a copy to begin with.
  targetOf(object) {
    if (object.userData.group) return object;
    const known = this.targets().find((ghost) => ghost.userData.of === object.name);
    if (known) return known;
    const ghost = ghostOf(this.thing(object.name), poseOf(object));
    ghost.name = object.name;
    ghost.userData = { group: "targets", thing: this.thing(object.name), of: object.name, isNew: true };
    this.ghosts[`targets ${ghost.name}`] = ghost;
    this.scene.add(ghost);
    return ghost;
  },

  dragTo(event) {
    const { object, half } = this.drag;
    this.drag.event = event;
    const point = this.aim(event);
    if (!point) return;
    const [low, high] = this.model.room;
    let x = THREE.MathUtils.clamp(point.x, low[0], high[0]);
    let y = THREE.MathUtils.clamp(point.y, low[1], high[1]);
    const near = this.slotAt(object, x, y);
    if (near) [x, y] = near.at;
    const under = this.support(x, y, half);
    if (under && !near && !event.shiftKey && this.dragging === "hand" && this.thing(under.name)) {
      [x, y] = this.flush([x, y], half, under);
    } else if (under && !near && !event.shiftKey) {
      const step = Math.min(half[0], half[1]) < FINE ? 0.001 : 0.005;
      x = under.middle[0] + step * Math.round((x - under.middle[0]) / step);
      y = under.middle[1] + step * Math.round((y - under.middle[1]) / step);
    }
    object.position.set(x, y, (under?.top ?? this.model.top) + half[2]);
    if (this.dragging === "hand") this.grasp();
    this.warn(object, !under);
    this.tell(event, near ? near.text : this.placeText(x, y, under));
    event.target.style.cursor = "grabbing";
    this.draw();
  },

  // The slot that would catch an object which is let go there: where its middle is, and what it is called.
  slotAt(object, x, y) {
    const name = object.userData.of ?? object.name;
    for (const kit of this.model.kits) {
      const { x: left, y: front } = this.bodies[kit.name].position;
      for (const slot of kit.slots) {
        const at = [left + slot.position[0], front + slot.position[1]];
        if (Math.hypot(x - at[0], y - at[1]) <= (slot.catches[name] ?? -1)) {
          return { at, text: `slot ${slot.name} of ${kit.name}` };
        }
      }
    }
    return null;
  },

  placeText(x, y, under) {
    if (!under) return "beside the tables";
    const [dx, dy] = [x - under.middle[0], y - under.middle[1]];
    const along = ([a, b]) => `${Math.round(1000 * (dx * a + dy * b)) + 0}`.replace("-", "\u2212");
    return `${under.name}: right ${along(this.model.right)}, back ${along(this.model.away)} mm`;
  },

  onUp(event) {
    if (this.pressed && !event.isPrimary) return;
    const { pressed, drag } = this;
    this.pressed = this.drag = null;
    if (!pressed) return;
    event.target.style.cursor = "";
    this.tip.style.display = "none";
    if (!drag) {
      const { object, point } = pressed;
      if (this.dragging === "things") this.$emit("point", { name: object.name, position: point.toArray() });
      else if (this.dragging !== "targets") this.$emit("pick", object.name);
      return;
    }
    this.warn(drag.object, false);
    this.dropped = drag.object;
    const where = { name: drag.object.name, position: drag.object.position.toArray(), turn: drag.turned };
    if (this.dragging === "hand") this.$emit("carry", where);
    else this.$emit("drop", { kind: this.dragging, ...where });
    this.draw();
  },

  cancelDrag() {
    if (this.drag) {
      const { object, before } = this.drag;
      setPose(object, before);
      this.warn(object, false);
      if (this.dragging === "hand") this.placeGripper(this.last.gripper);
      if (object.userData.isNew) {
        delete this.ghosts[`targets ${object.name}`];
        object.removeFromParent();
        discard(object);
      }
      this.tip.style.display = "none";
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

  halfOf(object) {
    return this.kit(object)?.half ?? halfOf(this.thingOf(object), object);
  },

  kit({ name }) {
    return this.model.kits.find((kit) => kit.name === name);
  },

  // The highest thing that the dragged object would stand on there, {name, middle, top}; null if that is the floor.
  support(x, y, half) {
    const { object: dragged } = this.drag;
    if (this.kit(dragged)) return supportUnder(x, y, half, this.model.tables, []);
    const parts = this.model.kits.flatMap(({ name, parts }) => {
      const kit = this.bodies[name].position;
      const middle = [kit.x, kit.y];
      return parts.map((part) => ({ name, middle, x: kit.x + part.x, y: kit.y + part.y, half: part.half, top: kit.z + part.top }));
    });
    const targets = this.dragging === "targets" ? this.targets() : [];
    const ended = targets.map((ghost) => ghost.userData.of); // these will be at their targets
    const bodies = this.model.objects.map(({ name }) => this.bodies[name]);
    const others = [...targets, ...bodies.filter(({ name }) => !ended.includes(name))]
      .filter((other) => other !== dragged)
      .map((other) => ({ object: other, thing: this.thingOf(other) }));
    return supportUnder(x, y, half, [...this.model.tables, ...parts], others);
  },
};
