// The bar between the scene and the panel: dragged, moved by the arrow keys, Home and End, and put back by a double-click. The
// browser remembers the part of the window that the scene has, in percent.
(() => {
  const [LEAST, MOST, FIRST, STEP] = [25, 75, 54, 3];
  const beside = matchMedia("(min-width: 761px), (max-height: 500px)"); // else the scene is above the panel
  let share = Number(remembered.get("scene-share", FIRST)) || FIRST;
  let dragged = null;

  function apply() {
    document.documentElement.style.setProperty("--scene-share", share);
    for (const bar of document.querySelectorAll("[role=separator][data-splitter]")) {
      Object.assign(bar, { ariaValueNow: `${Math.round(share)}`, ariaValueMin: `${LEAST}`, ariaValueMax: `${MOST}` });
      bar.ariaOrientation = beside.matches ? "vertical" : "horizontal";
    }
  }

  function move(to) {
    share = Math.min(MOST, Math.max(LEAST, to));
    remembered.set("scene-share", share);
    apply();
  }

  document.addEventListener("pointerdown", (event) => {
    if (!event.target.matches("[data-splitter]") || event.button !== 0) return;
    dragged = event.target;
    dragged.setPointerCapture(event.pointerId);
    event.preventDefault();
    dragged.focus();
  });
  document.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const { left, top, width, height } = dragged.parentElement.getBoundingClientRect();
    move(100 * (beside.matches ? (event.clientX - left) / width : (event.clientY - top) / height));
  });
  for (const end of ["pointerup", "pointercancel"]) document.addEventListener(end, () => (dragged = null));
  document.addEventListener("dblclick", (event) => {
    if (event.target.matches("[data-splitter]")) move(FIRST);
  });
  document.addEventListener("keydown", (event) => {
    if (!event.target.matches("[data-splitter]")) return;
    const to = { ArrowLeft: share - STEP, ArrowUp: share - STEP, ArrowRight: share + STEP, ArrowDown: share + STEP };
    const wanted = { ...to, Home: LEAST, End: MOST }[event.key];
    if (wanted === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    move(wanted);
  });
  beside.addEventListener("change", apply);
  window.addEventListener("load", apply);
  apply();
})();
