// The options of a menu lie in an element to which Quasar gives a tabindex. Screen readers then take it for an option itself.
new MutationObserver(() => {
  for (const content of document.querySelectorAll("[role=listbox] > [tabindex]:not([role])")) content.removeAttribute("tabindex");
}).observe(document.documentElement, { childList: true, subtree: true });
