// What an object would stand on.
import { THREE } from "nicegui-scene";

const TOUCH = 0.02; // as in bt_jax/mjx_env/surfaces.py

// The highest surface under an object with these half extents at x, y, null if there is none. `fixed` are surfaces {name,
// middle: [x, y], x, y, half: [x, y], top}, `others` are {object, thing}; all in metres.
export function supportUnder(x, y, half, fixed, others) {
  const [across, along] = half.map((extent) => extent * (1 - 2 * TOUCH));
  const under = [...fixed, ...others.map(topOf)].filter(
    (top) => Math.abs(top.x - x) < top.half[0] + across && Math.abs(top.y - y) < top.half[1] + along,
  );
  return under.reduce((best, one) => (best && best.top >= one.top ? best : one), null);
}

// Half the extents of a cuboid or cylinder along the world's axes, as it is turned.
export function halfOf({ shape, size }, { quaternion }) {
  const turn = new THREE.Matrix4().makeRotationFromQuaternion(quaternion).elements;
  const [x, y, z] = size.map((edge) => edge / 2);
  return [0, 1, 2].map((k) => {
    const up = Math.abs(turn[k + 8]);
    if (shape === "cylinder") return x * Math.sqrt(Math.max(0, 1 - up * up)) + z * up;
    return x * Math.abs(turn[k]) + y * Math.abs(turn[k + 4]) + z * up;
  });
}

// The upper surface of an object that may be tilted.
function topOf({ object, thing }) {
  const half = halfOf(thing, object);
  const { x, y, z } = object.position;
  return { name: thing.name, middle: [x, y], x, y, half: half.slice(0, 2), top: z + half[2] };
}
