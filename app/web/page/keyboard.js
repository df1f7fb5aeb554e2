// The app takes Enter and Space as keys of its own, and viser, which listens at the root of the page, then keeps them from
// the button that has the focus. So they end here, one step before, but for the button that was clicked last: it leaves them
// to the app until Tab is pressed, so that Space after a click still plays.
//
// The other way round, viser hears no key while a box, a choice or a list has the focus, as after every click on one. So
// keys that mean nothing there are said again where it listens. A list in which something was chosen by the mouse, or that
// was closed by Escape after a click, gives the focus back: its field takes letters, to search with. Fields: see fields.js.
{
  const MEANT = new Set([" ", "Enter", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "Home", "End", "Escape"]);
  const BUTTONS = "button, a[href], summary, input[type=checkbox], [role=button], [role=tab], [role=switch]";

  let clicked = null; // what the mouse pressed last; null once Tab was pressed
  addEventListener("pointerdown", (event) => { clicked = event.target.closest?.(BUTTONS) ?? event.target; }, true);
  addEventListener("keydown", (event) => { if (event.key === "Tab") clicked = null; }, true);

  const isForApp = (event) => {
    const field = event.target;
    if (!(field instanceof HTMLInputElement) || event.ctrlKey || event.metaKey || event.altKey) return false;
    if (event.key === "Shift" || event.key === "Tab") return false;
    if (field.type === "checkbox" || field.type === "radio") return Boolean(clicked) || !MEANT.has(event.key);
    return field.readOnly && field.getAttribute("aria-expanded") !== "true" && !MEANT.has(event.key);
  };

  const leaveList = (after, tries = 25) => { // it closes when the page is drawn again, and may take the focus once more
    const field = document.activeElement;
    if (clicked !== after || !tries) return;
    if (field.matches("[aria-haspopup=listbox]") && field.getAttribute("aria-expanded") !== "true") field.blur();
    else setTimeout(leaveList, 20, after, tries - 1);
  };

  const sayAgain = (event) => {
    if (!isForApp(event)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const { key, code, shiftKey, repeat } = event;
    document.body.dispatchEvent(new KeyboardEvent(event.type, { key, code, shiftKey, repeat, bubbles: true, cancelable: true }));
  };
  addEventListener("keydown", sayAgain, true);
  addEventListener("keyup", sayAgain, true);

  addEventListener("DOMContentLoaded", () => {
    document.body.addEventListener("keydown", (event) => {
      if (clicked && event.key === "Escape") setTimeout(leaveList, 0, clicked);
      if (event.key !== "Enter" && event.key !== " ") return;
      const button = event.target.closest(BUTTONS);
      if (button && button !== clicked) event.stopPropagation();
    });
    document.body.addEventListener("click", (event) => {
      if (clicked && event.target.closest("[role=option]")) setTimeout(leaveList, 0, clicked);
    });
  });

  // A key that nothing takes says so: viser's page and ours have stopped or answered all that mean something.
  let keys = { mode: "", moves_camera: true };
  rallyscope.handlers.keys = (message) => { keys = message; };
  const MEANS_MORE = "input:not([type=checkbox]), textarea, select, [contenteditable], [role=combobox], [class*=mantine-Modal-content], [class*=Spotlight], dialog";
  addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.isComposing || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    if (!keys.mode || !/^\S$/u.test(event.key) || event.target.closest?.(MEANS_MORE)) return;
    if (keys.moves_camera && /^Key[WASDQE]$/.test(event.code)) return;
    const name = (event.shiftKey && /\p{L}/u.test(event.key) ? "Shift " : "") + event.key.toUpperCase();
    rallyscope.showLine(`Key ${name} does nothing in ${keys.mode}. The keys are listed under Keys.`);
  });
}
