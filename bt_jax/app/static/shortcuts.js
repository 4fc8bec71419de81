// Single keys that do something can be switched off, by whom speech or a slip presses them unasked. The scripts that take keys see
// it as data-shortcuts (on, off) of <html>; the buttons with data-shortcuts-button switch it.
(() => {
  function apply(state) {
    document.documentElement.dataset.shortcuts = state;
    for (const button of document.querySelectorAll("[data-shortcuts-button]")) {
      button.ariaPressed = `${state === "on"}`;
      button.title = `Single keys as shortcuts: ${state}`;
    }
  }

  document.addEventListener("click", (event) => {
    if (!event.target.closest("[data-shortcuts-button]")) return;
    const state = document.documentElement.dataset.shortcuts === "on" ? "off" : "on";
    remembered.set("shortcuts", state);
    apply(state);
  });
  const apply_now = () => apply(remembered.get("shortcuts", "on"));
  window.addEventListener("load", apply_now);
  apply_now();
})();
