// Motions: states {objects: [pose, ...], gripper, base} that follow each other evenly.
import { THREE } from "nicegui-scene";

// The state at a part (0 to 1) of a motion.
export function stateAt(states, part) {
  const at = Math.min(1, Math.max(0, part)) * (states.length - 1);
  const i = Math.min(Math.floor(at), states.length - 2);
  return between(states[i], states[i + 1], at - i);
}

function between(a, b, part) {
  const mix = (p, q) => p.map((value, k) => value + part * (q[k] - value));
  const objects = a.objects.map((from, k) => {
    const to = b.objects[k];
    const turn = new THREE.Quaternion(from[4], from[5], from[6], from[3]);
    turn.slerp(new THREE.Quaternion(to[4], to[5], to[6], to[3]), part);
    return [...mix(from.slice(0, 3), to.slice(0, 3)), turn.w, turn.x, turn.y, turn.z];
  });
  const [gripper, base] = ["gripper", "base"].map((key) => (a[key] && b[key] ? mix(a[key], b[key]) : b[key]));
  return { objects, gripper, base };
}
