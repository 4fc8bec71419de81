// Keeps the keyboard focus when a part of the page is built again: on the element with the same test id, or on the tab of the
// step if there is none any more.
(() => {
  let last = null;
  document.addEventListener("focusin", (event) => (last = event.target));
  new MutationObserver(() => {
    if (!last || last.isConnected || document.activeElement !== document.body) return;
    const name = last.dataset.testid;
    last = null;
    const again = name && document.querySelector(`[data-testid="${CSS.escape(name)}"]`);
    const usable = again && again.offsetParent !== null && !again.disabled;
    (usable ? again : document.querySelector("[role=tab][aria-selected=true]"))?.focus({ preventScroll: true });
  }).observe(document.documentElement, { childList: true, subtree: true });
})();
