// The scene of a task in three.js. It is drawn only when something has changed, coarsely while it moves in software.
// Poses are [x, y, z, qw, qx, qy, qz] in the world, metres, z up, as everywhere in bt_jax.
import { OrbitControls, THREE } from "nicegui-scene";

const GLIDE = 180; // milliseconds
const TAG = 17; // pixels
const CLICK = 4; // pixels by which a pointer may move in a click
const TOUCH = 0.02; // as in bt_jax/mjx_env/surfaces.py
const WARN = 0xd55e00;
const LOOKS = {
  ArrowLeft: [-0.1, 0, 1],
  ArrowRight: [0.1, 0, 1],
  ArrowUp: [0, 0.1, 1],
  ArrowDown: [0, -0.1, 1],
  "+": [0, 0, 0.9],
  "=": [0, 0, 0.9],
  "-": [0, 0, 1.1],
};
const AXIS = new THREE.Vector3(0, 0, 1);

function softwareOnly() {
  const gl = document.createElement("canvas").getContext("webgl");
  const info = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !info || /swiftshader|llvmpipe|software/i.test(gl.getParameter(info.UNMASKED_RENDERER_WEBGL));
}

function setPose(object, pose) {
  object.position.set(pose[0], pose[1], pose[2]);
  object.quaternion.set(pose[4], pose[5], pose[6], pose[3]);
}

function poseOf({ position: p, quaternion: q }) {
  return [p.x, p.y, p.z, q.w, q.x, q.y, q.z];
}

function geometryOf({ type, size }) {
  if (type === "cylinder") return new THREE.CylinderGeometry(size[0], size[0], 2 * size[1], 20).rotateX(Math.PI / 2);
  return new THREE.BoxGeometry(2 * size[0], 2 * size[1], 2 * size[2]);
}

function outline(geometry, material) {
  const lines = new THREE.LineSegments(new THREE.EdgesGeometry(geometry), material);
  if (material.isLineDashedMaterial) lines.computeLineDistances();
  return lines;
}

function nameTag(text) {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = "500 42px sans-serif";
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 36;
  canvas.height = 64;
  context.font = font;
  context.fillStyle = "rgba(255, 255, 255, 0.88)";
  context.beginPath();
  context.roundRect(0, 0, canvas.width, canvas.height, 20);
  context.fill();
  context.fillStyle = "#1d2733";
  context.textBaseline = "middle";
  context.fillText(text, 18, 34);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  const material = { map: texture, depthTest: false, transparent: true, sizeAttenuation: false };
  const tag = new THREE.Sprite(new THREE.SpriteMaterial(material));
  tag.userData.shape = canvas.width / canvas.height;
  tag.center.set(-19 / (TAG * tag.userData.shape), 0.5); // at the right of a box, so that those of a stack keep apart
  tag.renderOrder = 10;
  return tag;
}

// Gives back what an object and all in it take of the graphics memory.
function discard(object) {
  object.traverse(({ geometry, material }) => {
    geometry?.dispose();
    material?.map?.dispose();
    material?.dispose();
  });
}

export default {
  template: `<div style="position: absolute; inset: 0">
    <canvas style="display: block; touch-action: none; outline-offset: -3px" tabindex="0"></canvas>
    <div class="scene-tip" style="display: none"></div>
  </div>`,

  props: { model: Object, label: String },

  mounted() {
    const canvas = this.$el.children[0];
    this.tip = this.$el.children[1];
    this.rendered = 0; // pictures so far, for whoever measures
    this.software = softwareOnly();
    try {
      // Opaque, which three.js does not ask for by itself: nothing is blended with the page behind.
      const context = canvas.getContext("webgl2", { alpha: false, antialias: !this.software, powerPreference: "low-power" });
      this.renderer = new THREE.WebGLRenderer({ canvas, context });
      this.renderer.debug.checkShaderErrors = false; // each check waits until the shader is compiled
    } catch {
      this.$el.textContent = "This browser cannot draw in 3D; switch WebGL on, or use another browser.";
      return;
    }
    // Software is too slow for smooth edges: every picture of them would stall the page.
    this.renderer.setPixelRatio(this.software ? 1 : Math.min(window.devicePixelRatio, 2));
    this.renderer.setClearColor(0xaeb6c0); // the floor, which need not be drawn then
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", this.label);
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.02, 80);
    this.camera.up.copy(AXIS);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 1.45;
    this.controls.addEventListener("change", () => this.draw());
    this.raycaster = new THREE.Raycaster();
    this.frame = (time) => this.onFrame(time);
    canvas.addEventListener("pointerdown", this.onDown, { capture: true });
    canvas.addEventListener("pointermove", this.onMove);
    canvas.addEventListener("pointerup", this.onUp);
    canvas.addEventListener("pointercancel", this.cancelDrag);
    canvas.addEventListener("pointerleave", () => (this.tip.style.display = "none"));
    window.addEventListener("keydown", this.onKey);
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
    // What the scene consists of -------------------------------------------------------------------------------------
    build() {
      if (this.scene) discard(this.scene);
      this.scene = new THREE.Scene();
      this.scene.add(new THREE.HemisphereLight(0xffffff, 0x9aa4b0, 1.9));
      const key = new THREE.DirectionalLight(0xffffff, 1.5);
      key.position.set(...this.model.light);
      this.scene.add(key);
      this.bodies = {};
      this.ghosts = {};
      this.motion = this.drag = this.frozen = this.dropped = null;
      this.dragging = "";
      for (const geom of this.model.geoms.filter(({ type }) => type !== "plane")) {
        const geometry = geometryOf(geom);
        const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: new THREE.Color(...geom.color) }));
        setPose(mesh, geom.pose);
        if (geom.type === "box") {
          mesh.add(outline(geometry, new THREE.LineBasicMaterial({ color: 0x1d2733, transparent: true, opacity: 0.35 })));
        }
        this.body(geom.body).add(mesh);
      }
      this.tags = this.model.boxes.map((box) => {
        const tag = nameTag(box.name);
        this.bodies[box.name].add(tag);
        return tag;
      });
      this.lookAtAll();
      this.resize();
    },

    body(name) {
      if (!this.bodies[name]) {
        this.bodies[name] = new THREE.Group();
        this.bodies[name].name = name;
        this.scene.add(this.bodies[name]);
      }
      return this.bodies[name];
    },

    box(name) {
      return this.model.boxes.find((box) => box.name === name);
    },

    // What Python tells it -------------------------------------------------------------------------------------------
    // Glides to a state: {boxes: [pose, ...], kit: pose, gripper: [x, y, z, opening, yaw]}.
    show(state, glide = true) {
      setPose(this.bodies[this.model.kit], state.kit);
      const now = this.state();
      this.frozen = this.dropped = null;
      this.last = state;
      if (!glide || document.hidden) {
        this.motion = null;
        this.place(state.boxes, state.gripper);
      } else {
        this.motion = { frames: [now, state], began: performance.now(), milliseconds: GLIDE };
      }
      this.draw();
    },

    // Runs through states that follow each other evenly in this time.
    play(frames, milliseconds) {
      this.frozen = null;
      this.last = frames.at(-1);
      this.motion = { frames, began: performance.now(), milliseconds };
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

    // Translucent copies of boxes, [{name, pose, text}]; those of the group "targets" can be dragged.
    setGhosts(group, ghosts) {
      for (const [key, ghost] of Object.entries(this.ghosts)) {
        if (ghost.userData.group !== group) continue;
        ghost.removeFromParent();
        discard(ghost);
        delete this.ghosts[key];
      }
      for (const { name, pose, text } of ghosts) {
        const { size, color } = this.box(name);
        const geometry = new THREE.BoxGeometry(size * 1.01, size * 1.01, size * 1.01);
        const material = { color: new THREE.Color(...color), transparent: true, opacity: 0.3, depthWrite: false };
        const ghost = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(material));
        const dashes = { color: 0x1d2733, dashSize: size / 9, gapSize: size / 12 };
        ghost.add(outline(geometry, new THREE.LineDashedMaterial(dashes)));
        setPose(ghost, pose);
        ghost.name = name;
        ghost.userData = { group, text };
        this.ghosts[`${group} ${name}`] = ghost;
        this.scene.add(ghost);
      }
      this.draw();
    },

    // What became of a box that was dropped is known, and shown next.
    drop() {
      this.dropped = null;
      if (!this.motion && !this.frozen) this.place(this.last.boxes, this.last.gripper);
      this.draw();
    },

    // What can be dragged: "boxes", "targets" or "" for nothing.
    setDragging(what) {
      this.cancelDrag();
      this.dragging = what;
    },

    // Motion ---------------------------------------------------------------------------------------------------------
    state() {
      return { boxes: this.model.boxes.map(({ name }) => poseOf(this.bodies[name])), gripper: this.gripper };
    },

    place(boxes, gripper) {
      this.model.boxes.forEach(({ name }, i) => {
        const body = this.bodies[name];
        if (body !== this.drag?.object && body !== this.dropped) setPose(body, boxes[i]);
      });
      this.gripper = gripper;
      const [x, y, z, opening, yaw] = gripper;
      const along = new THREE.Vector3(Math.cos(yaw), Math.sin(yaw), 0);
      for (const [name, side] of [["gripper", 0], ["finger_right", 1], ["finger_left", -1]]) {
        this.bodies[name].position.set(x, y, z).addScaledVector(along, (side * opening) / 2);
        this.bodies[name].quaternion.setFromAxisAngle(AXIS, yaw);
      }
    },

    advance(time) {
      const { frames, began, milliseconds } = this.motion;
      const at = Math.min(1, Math.max(0, (time - began) / milliseconds)) * (frames.length - 1);
      const i = Math.min(Math.floor(at), frames.length - 2);
      const part = at - i;
      const [a, b] = [frames[i], frames[i + 1]];
      const mix = (p, q) => p.map((value, k) => value + part * (q[k] - value));
      const q = new THREE.Quaternion();
      const boxes = a.boxes.map((pose, k) => {
        const [from, to] = [pose, b.boxes[k]];
        q.set(from[4], from[5], from[6], from[3]).slerp(new THREE.Quaternion(to[4], to[5], to[6], to[3]), part);
        return [...mix(from.slice(0, 3), to.slice(0, 3)), q.w, q.x, q.y, q.z];
      });
      this.place(boxes, a.gripper ? mix(a.gripper, b.gripper) : b.gripper);
      if (time >= began + milliseconds) this.motion = null;
    },

    // Drawing --------------------------------------------------------------------------------------------------------
    draw() {
      if (this.pending) return;
      this.pending = true;
      requestAnimationFrame(this.frame);
    },

    onFrame(time) {
      this.pending = false;
      if (!this.renderer) return;
      if (this.motion) this.advance(time);
      this.renderer.render(this.scene, this.camera);
      this.rendered += 1;
      if (this.motion) this.draw();
    },

    resize() {
      const { clientWidth: width, clientHeight: height } = this.$el;
      if (!width || !height) return;
      this.renderer.setSize(width, height, false);
      Object.assign(this.$el.children[0].style, { width: `${width}px`, height: `${height}px` });
      this.camera.aspect = width / height;
      this.fit();
      this.draw();
    },

    // The angle of view that takes in all that matters across, and up and down.
    fit() {
      const { across, upright } = this.model.camera;
      const tangent = Math.max(upright, across / this.camera.aspect);
      this.camera.fov = 2 * THREE.MathUtils.radToDeg(Math.atan(tangent));
      this.camera.updateProjectionMatrix();
      const height = (TAG * 2 * tangent) / this.$el.clientHeight;
      for (const tag of this.tags) tag.scale.set(height * tag.userData.shape, height, 1);
    },

    lookAtAll() {
      const { eye, target } = this.model.camera;
      this.camera.position.set(...eye);
      this.controls.target.set(...target);
      this.controls.update();
      this.draw();
    },

    // Pointer --------------------------------------------------------------------------------------------------------
    hit(event, objects) {
      const { left, top, width, height } = this.$el.getBoundingClientRect();
      const x = ((event.clientX - left) / width) * 2 - 1;
      const y = 1 - ((event.clientY - top) / height) * 2;
      this.raycaster.setFromCamera(new THREE.Vector2(x, y), this.camera);
      return this.raycaster.intersectObjects(objects, true).find(({ object }) => object.isMesh);
    },

    handle(event) {
      const boxes = this.model.boxes.map(({ name }) => this.bodies[name]);
      const targets = Object.values(this.ghosts).filter((ghost) => ghost.userData.group === "targets");
      const found = this.hit(event, this.dragging === "targets" ? targets : boxes);
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
      this.drag = { object, plane, offset, before: poseOf(object), size: this.box(object.name).size };
    },

    dragTo(event) {
      const { object, plane, offset, size } = this.drag;
      this.hit(event, []);
      const point = this.raycaster.ray.intersectPlane(plane, new THREE.Vector3());
      if (!point) return;
      const [low, high] = this.model.room;
      const x = THREE.MathUtils.clamp(point.x + offset.x, low[0], high[0]);
      const y = THREE.MathUtils.clamp(point.y + offset.y, low[1], high[1]);
      const height = this.support(x, y, size / 2);
      object.position.set(x, y, (height ?? this.model.top) + size / 2);
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
        if (!this.dragging || this.dragging === "boxes") this.$emit("pick", pressed.object.name);
        return;
      }
      this.warn(drag.object, false);
      this.dropped = drag.object;
      this.$emit("drop", { kind: this.dragging, name: drag.object.name, position: drag.object.position.toArray() });
      this.draw();
    },

    onKey(event) {
      if (event.key === "Escape") this.cancelDrag();
      if (event.target === this.$el.children[0] && event.key in LOOKS) {
        event.preventDefault();
        this.lookFrom(...LOOKS[event.key]);
      }
    },

    // Turns the view about what it looks at, by so many radians to the right and up, and to so many times the distance.
    lookFrom(right, up, times) {
      const { target } = this.controls;
      const offset = this.camera.position.clone().sub(target);
      const across = new THREE.Vector3().crossVectors(AXIS, offset).normalize();
      offset.applyAxisAngle(across, -up).applyAxisAngle(AXIS, right).multiplyScalar(times);
      this.camera.position.copy(target).add(offset);
      this.controls.update();
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

    // Height of the highest thing that the dragged box would stand on there, null where that is the floor.
    support(x, y, half) {
      const tops = [...this.model.tables];
      const kit = this.bodies[this.model.kit].position;
      for (const part of this.model.kit_parts) {
        tops.push({ x: kit.x + part.x, y: kit.y + part.y, half: part.half, top: kit.z + part.top });
      }
      const others = this.dragging === "targets" ? Object.values(this.ghosts) : this.model.boxes.map(({ name }) => this.bodies[name]);
      for (const other of others) {
        if (other === this.drag.object) continue;
        const bounds = new THREE.Matrix4().makeRotationFromQuaternion(other.quaternion).elements;
        const reach = this.box(other.name).size / 2;
        const extent = [0, 1, 2].map((k) => reach * (Math.abs(bounds[k]) + Math.abs(bounds[k + 4]) + Math.abs(bounds[k + 8])));
        const { x: cx, y: cy, z } = other.position;
        tops.push({ x: cx, y: cy, half: extent.slice(0, 2), top: z + extent[2] });
      }
      const slim = half * (1 - 2 * TOUCH);
      const under = tops.filter((t) => Math.abs(t.x - x) < t.half[0] + slim && Math.abs(t.y - y) < t.half[1] + slim);
      return under.length ? Math.max(...under.map(({ top }) => top)) : null;
    },
  },
};
