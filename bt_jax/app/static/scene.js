// The scene of a task in three.js, drawn only when something has changed.
// Poses are [x, y, z, qw, qx, qy, qz] in the world, metres, z up, as everywhere in bt_jax.
import { OrbitControls, THREE } from "nicegui-scene";
import { hand } from "bt_jax-scene/hand.js";
import { stateAt } from "bt_jax-scene/motion.js";
import { pointer } from "bt_jax-scene/pointer.js";
import { groundOf, lightsOf } from "bt_jax-scene/room.js";
import { discard, ghostOf, meshOf, poseOf, setPose, softwareOnly } from "bt_jax-scene/shapes.js";
import { keepApart, nameTag, slotTag } from "bt_jax-scene/tags.js";
import { view } from "bt_jax-scene/view.js";

const GLIDE = 180; // milliseconds
const MANY = 6; // objects, from which their names would hide too much
const STILL = matchMedia("(prefers-reduced-motion: reduce)");
const AXIS = new THREE.Vector3(0, 0, 1);

export default {
  template: `<div style="position: absolute; inset: 0">
    <canvas style="display: block; touch-action: none; outline-offset: -3px" tabindex="0"></canvas>
    <div class="scene-tip" style="display: none"></div>
  </div>`,

  props: { model: Object, label: String },

  mounted() {
    const canvas = this.$el.children[0];
    this.tip = this.$el.children[1];
    this.extent = [1, 1]; // pixels across, and up and down
    this.rendered = 0; // pictures so far, for measurements
    this.quarter = 0; // by which the view is turned, as Python knows it
    this.software = softwareOnly();
    try {
      // Opaque, which is not the default of three.js: nothing is blended with the page behind.
      const context = canvas.getContext("webgl2", { alpha: false, antialias: !this.software, powerPreference: "low-power" });
      this.renderer = new THREE.WebGLRenderer({ canvas, context });
      this.renderer.shadowMap.enabled = true;
      this.renderer.shadowMap.type = this.software ? THREE.BasicShadowMap : THREE.PCFSoftShadowMap;
      this.renderer.shadowMap.autoUpdate = false; // shadows stay while only the view turns
      this.renderer.debug.checkShaderErrors = false; // each check waits until the shader is compiled
    } catch {
      this.$el.textContent = "This browser cannot draw in 3D; switch WebGL on, or use another browser.";
      return;
    }
    // Software is too slow for smooth edges: every picture of them would stall the page.
    this.renderer.setPixelRatio(this.software ? 1 : Math.min(window.devicePixelRatio, 2));
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", this.label);
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.02, 80);
    this.camera.up.copy(AXIS);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 1.45;
    this.controls.addEventListener("start", () => (this.looking = null));
    this.controls.addEventListener("change", () => {
      this.tellQuarter();
      this.redraw();
    });
    this.raycaster = new THREE.Raycaster();
    this.frame = (time) => this.onFrame(time);
    canvas.addEventListener("pointerdown", this.onDown, { capture: true });
    canvas.addEventListener("pointermove", this.onMove);
    canvas.addEventListener("pointerup", this.onUp);
    canvas.addEventListener("wheel", this.onWheel, { capture: true, passive: false });
    window.addEventListener("keydown", this.onHandKey, { capture: true });
    canvas.addEventListener("pointercancel", this.cancelDrag);
    canvas.addEventListener("pointerleave", () => (this.tip.style.display = "none"));
    window.addEventListener("keydown", this.onKey);
    window.addEventListener("appearance", this.paintGround);
    canvas.addEventListener("dblclick", () => this.lookAtAll());
    canvas.addEventListener("webglcontextrestored", () => this.draw());
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.$el);
    this.build();
    this.connecting = setInterval(() => {
      if (window.socket?.id === undefined) return;
      clearInterval(this.connecting);
      this.$emit("ready");
    }, 50);
  },

  beforeUnmount() {
    window.removeEventListener("keydown", this.onKey);
    window.removeEventListener("keydown", this.onHandKey, { capture: true });
    window.removeEventListener("appearance", this.paintGround);
    clearInterval(this.connecting);
    this.observer?.disconnect();
    this.controls?.dispose();
    if (this.scene) discard(this.scene);
    this.renderer?.dispose();
    this.renderer = null;
  },

  watch: {
    model() {
      if (!this.renderer) return;
      this.build();
      this.$emit("ready");
    },
  },

  methods: {
    ...view,
    ...pointer,
    ...hand,
    build() {
      if (this.scene) discard(this.scene);
      this.scene = new THREE.Scene();
      this.scene.add(...lightsOf(this.model, this.software));
      this.ground = null;
      this.paintGround();
      this.bodies = {};
      this.ghosts = {};
      this.motion = this.drag = this.frozen = this.dropped = this.gripper = this.base = this.origins = null; // until Python shows a state
      this.dragging = "";
      for (const geom of this.model.geoms.filter(({ type }) => type !== "plane")) this.body(geom.body).add(meshOf(geom));
      this.tags = this.model.objects.map(({ name }) => {
        const tag = nameTag(name, this.model.objects.length > MANY);
        this.bodies[name].add(tag);
        return tag;
      });
      for (const { name, slots } of this.model.kits) {
        for (const slot of slots) {
          const tag = slotTag(slot.name);
          tag.position.set(...slot.position);
          this.bodies[name].add(tag);
          this.tags.push(tag);
        }
      }
      this.looking = "home";
      this.resize();
      this.draw();
    },

    body(name) {
      if (!this.bodies[name]) {
        this.bodies[name] = new THREE.Group();
        this.bodies[name].name = name;
        this.scene.add(this.bodies[name]);
      }
      return this.bodies[name];
    },

    thing(name) {
      return this.model.objects.find((thing) => thing.name === name);
    },

    // Glides to a state: {objects: [pose, ...], kits: [pose, ...], gripper: [x, y, z, opening, yaw], base: [x, y, z] or null}.
    show(state, glide = true) {
      this.origins = state.kits;
      this.placeKits();
      const now = this.state();
      this.frozen = this.dropped = null;
      this.last = state;
      if (!glide || document.hidden || STILL.matches) {
        this.motion = null;
        this.place(state);
      } else {
        this.motion = { states: [now, state], began: performance.now(), milliseconds: GLIDE };
      }
      this.draw();
    },

    placeKits() {
      this.origins?.forEach((origin, k) => setPose(this.bodies[this.model.kits[k].name], origin));
    },

    // Runs through states that follow each other evenly, in this time.
    play(states, milliseconds) {
      this.frozen = null;
      this.last = states.at(-1);
      if (STILL.matches) {
        this.motion = null;
        this.place(this.last);
        return this.draw();
      }
      this.motion = { states, began: performance.now(), milliseconds };
      this.draw();
    },

    // Holds a motion still, and lets it go on.
    freeze(still) {
      if (still && this.motion) {
        this.frozen = { motion: this.motion, done: performance.now() - this.motion.began };
        this.motion = null;
      } else if (!still && this.frozen) {
        this.motion = { ...this.frozen.motion, began: performance.now() - this.frozen.done };
        this.frozen = null;
        this.draw();
      }
    },

    // Translucent copies of objects, [{key, name, pose, text, odd}]; those of the group "targets" can be dragged.
    setGhosts(group, ghosts) {
      for (const [id, ghost] of Object.entries(this.ghosts)) {
        if (ghost.userData.group !== group) continue;
        ghost.removeFromParent();
        discard(ghost);
        delete this.ghosts[id];
      }
      for (const { key, name, pose, text, odd } of ghosts) {
        const ghost = ghostOf(this.thing(name), pose);
        ghost.name = key;
        ghost.userData = { group, text, thing: this.thing(name), of: name };
        this.ghosts[`${group} ${key}`] = ghost;
        this.scene.add(ghost);
        if (odd) this.warn(ghost, true);
      }
      this.draw();
    },

    // Python has taken or refused what was dropped, and shows the scene next.
    drop() {
      this.dropped = null;
      this.placeKits();
      if (!this.motion && !this.frozen) this.place(this.last);
      this.draw();
    },

    // What can be dragged: "objects", "targets", "things" (objects and kits), "hand" for objects that the gripper carries, or ""
    // for nothing.
    setDragging(what) {
      this.cancelDrag();
      this.dragging = what;
    },

    state() {
      const objects = this.model.objects.map(({ name }) => poseOf(this.bodies[name]));
      return { objects, gripper: this.gripper, base: this.base };
    },

    place({ objects, gripper, base }) {
      this.model.objects.forEach(({ name }, i) => {
        const body = this.bodies[name];
        if (body !== this.drag?.object && body !== this.dropped) setPose(body, objects[i]);
      });
      this.base = base;
      if (base) this.bodies["scene/base"].position.set(...base);
      this.placeGripper(gripper);
    },

    placeGripper(gripper) {
      this.gripper = gripper;
      const [x, y, z, opening, yaw] = gripper;
      const along = new THREE.Vector3(Math.cos(yaw), Math.sin(yaw), 0);
      for (const [name, side] of [["scene/gripper", 0], ["scene/finger_right", 1], ["scene/finger_left", -1]]) {
        this.bodies[name].position.set(x, y, z).addScaledVector(along, (side * opening) / 2);
        this.bodies[name].quaternion.setFromAxisAngle(AXIS, yaw);
      }
    },

    advance(time) {
      const { states, began, milliseconds } = this.motion;
      this.place(stateAt(states, (time - began) / milliseconds));
      if (time >= began + milliseconds) this.motion = null;
    },

    paintGround() {
      const style = getComputedStyle(this.$el);
      const [ground, behind] = ["--ground", "--scene"].map((name) => new THREE.Color(style.getPropertyValue(name).trim()));
      this.renderer.setClearColor(behind);
      if (this.ground) discard(this.ground);
      this.ground?.removeFromParent();
      this.ground = groundOf(this.model, ground, behind, this.software);
      this.scene.add(this.ground);
      this.draw();
    },

    // Draws the scene, in which something may have moved.
    draw() {
      this.renderer.shadowMap.needsUpdate = true;
      this.redraw();
    },

    // Draws the scene, in which nothing has moved, from elsewhere.
    redraw() {
      if (this.pending) return;
      this.pending = true;
      requestAnimationFrame(this.frame);
    },

    onFrame(time) {
      this.pending = false;
      if (!this.renderer) return;
      if (this.motion) this.advance(time);
      keepApart(this.tags, this.camera, this.extent);
      this.renderer.render(this.scene, this.camera);
      this.rendered += 1;
      if (this.motion) this.draw();
    },
  },
};
