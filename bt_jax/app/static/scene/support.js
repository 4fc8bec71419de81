// What a box would stand on.
import { THREE } from "nicegui-scene";

const TOUCH = 0.02; // as in bt_jax/mjx_env/scene/surfaces.py

// Height of the highest surface under a box with this half size at x, y, null if there is none. `fixed` are surfaces
// {x, y, half: [x, y], top}, `boxes` are {object, size}; all in metres.
export function supportHeight(x, y, half, fixed, boxes) {
  const slim = half * (1 - 2 * TOUCH);
  const under = [...fixed, ...boxes.map(topOf)].filter(
    (top) => Math.abs(top.x - x) < top.half[0] + slim && Math.abs(top.y - y) < top.half[1] + slim,
  );
  return under.length ? Math.max(...under.map(({ top }) => top)) : null;
}

// The upper surface of a box that may be tilted.
function topOf({ object: { position, quaternion }, size }) {
  const turn = new THREE.Matrix4().makeRotationFromQuaternion(quaternion).elements;
  const extent = [0, 1, 2].map(
    (k) => (size / 2) * (Math.abs(turn[k]) + Math.abs(turn[k + 4]) + Math.abs(turn[k + 8])),
  );
  return { x: position.x, y: position.y, half: extent.slice(0, 2), top: position.z + extent[2] };
}
