// Ctrl+Z presses the visible button with data-undo, Ctrl+Shift+Z and Ctrl+Y the one with data-redo. In a text field they change
// the text.
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
  if (event.target.closest("input, textarea, [contenteditable=true], .q-dialog")) return;
  const key = event.key.toLowerCase();
  const wanted = key === "y" || (key === "z" && event.shiftKey) ? "data-redo" : key === "z" ? "data-undo" : null;
  const button = wanted && [...document.querySelectorAll(`[${wanted}]`)].find((found) => found.offsetParent !== null);
  if (!button) return;
  event.preventDefault();
  button.click();
});
