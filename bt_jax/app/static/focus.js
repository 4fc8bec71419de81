// Keeps the keyboard focus when what has it is built again, hidden or disabled: it goes to the element with the same test id, else
// to what is nearest in the same part of the page, else to the tab of the step; never to the body.
(() => {
  const STOPS = "button, input, select, textarea, a[href], [tabindex]:not([tabindex='-1'])";
  let last = null;
  let around = []; // the elements that it lies in, the innermost first
  let asked = false;

  document.addEventListener("focusin", (event) => {
    last = event.target.matches(".q-focus-helper") ? event.target.parentElement : event.target; // of Quasar, after a click
    around = [];
    for (let part = last.parentElement; part && part !== document.body; part = part.parentElement) around.push(part);
  });
  // Who clicks where nothing can be focused takes the focus away.
  document.addEventListener("pointerdown", (event) => {
    if (!event.target.closest(`${STOPS}, [tabindex], label`)) last = null;
  });

  const usable = (one) => one && one.isConnected && !one.disabled && !one.closest("[inert]") && one.checkVisibility();

  function nearest() {
    const name = last.dataset.testid;
    const again = name && document.querySelector(`[data-testid="${CSS.escape(name)}"]`);
    if (usable(again)) return again;
    for (const part of around) {
      const found = part.isConnected && [...part.querySelectorAll(STOPS)].filter(usable);
      if (!found || !found.length) continue;
      const inside = last.isConnected && part.closest(".page-panel, .page-header, .notices");
      const before = (one) => last.compareDocumentPosition(one) & Node.DOCUMENT_POSITION_PRECEDING;
      return (inside && found.findLast(before)) || found[0]; // a part that was shown instead begins at its first
    }
    return document.querySelector("[role=tab][aria-selected=true]");
  }

  function restore() {
    asked = false;
    const lost = [document.body, null, last].includes(document.activeElement); // what was hidden just now has it still
    if (!last || !lost || document.body.classList.contains("offline") || usable(last)) return;
    nearest()?.focus({ preventScroll: true });
  }

  new MutationObserver(() => {
    if (asked || !last) return;
    asked = true;
    requestAnimationFrame(restore);
  }).observe(document.documentElement, {
    childList: true,
    subtree: true,
    attributeFilter: ["disabled", "hidden", "style", "class", "inert"],
  });

  // Focuses an element that is about to be shown.
  window.focusSoon = (selector) =>
    setTimeout(() => {
      const element = document.querySelector(selector);
      if (usable(element)) element.focus({ preventScroll: true });
    });
})();
