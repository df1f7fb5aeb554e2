// viser sends what changes at most every 50 ms, and of all that changed within them only the last. A page that is drawing
// handles a letter and the Enter or the click after it at once: so a button that comes so soon waits until the letter is sent.
{
  const SENT_MS = 60;
  let changed = -Infinity;
  for (const kind of ["input", "change"])
    addEventListener(kind, () => { changed = performance.now(); }, { capture: true, passive: true });

  addEventListener("click", (event) => {
    const button = event.target instanceof Element && event.target.closest("button"); // Enter in a form is a click, too
    const left = changed + SENT_MS - performance.now();
    if (!button || left <= 0) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    setTimeout(() => { if (button.isConnected) button.click(); }, left);
  }, true);
}
