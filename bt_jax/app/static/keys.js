// Sends keys for the gripper to the server as event "teach_key", but only while the element with data-teach-keys is visible and
// nobody is typing, and unless a person has switched single keys off. These keys neither scroll the page nor move the focus. A key
// that is held is sent again and again.
document.addEventListener(
  "keydown",
  (event) => {
    const area = document.querySelector("[data-teach-keys]");
    if (!area || area.offsetParent === null || area.closest("[inert]")) return;
    if (event.target.closest("input, textarea, select, [contenteditable=true], [role=slider], [role=separator], .q-menu, .q-dialog")) return;
    if (event.key.startsWith("Arrow") && event.target.closest("[role=tab], [role=tablist], [role=radiogroup]")) return;
    const undo = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z";
    if (!undo && document.documentElement.dataset.shortcuts === "off") return;
    if (!undo && (event.ctrlKey || event.metaKey || event.altKey)) return;
    const key = undo ? "undo" : event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!undo && !area.dataset.teachKeys.split(" ").includes(key)) return;
    event.preventDefault();
    event.stopPropagation();
    const { repeat, timeStamp } = event;
    if (repeat && !/^(Arrow|Page)|^[qe]$/.test(key)) return;
    if (repeat && timeStamp - (window.lastTeachKey ?? 0) < 60) return;
    window.lastTeachKey = timeStamp;
    emitEvent("teach_key", { key, repeat });
  },
  true,
);
