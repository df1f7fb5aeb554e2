// The app takes Enter and Space as keys of its own, and viser, which listens at the root of the page, then keeps them from
// the button that has the focus. So they end here, one step before, for a button that was reached by Tab; one that was
// clicked leaves them to the app, so that Space after a click still plays.
//
// The other way round, viser hears no key while a box, a choice or a list has the focus, as after every click on one. So
// keys that mean nothing there are said again where it listens.
{
  const MEANT = new Set([" ", "Enter", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "Home", "End", "Escape"]);

  let clicked = false; // the focus came by the mouse, not by Tab
  addEventListener("pointerdown", () => { clicked = true; }, true);

  const isForApp = (event) => {
    const field = event.target;
    if (!(field instanceof HTMLInputElement) || event.ctrlKey || event.metaKey || event.altKey) return false;
    if (event.key === "Shift") return false;
    if (event.key === "Tab") return (clicked = false);
    if (field.type === "checkbox" || field.type === "radio") return clicked || !MEANT.has(event.key);
    return field.readOnly && field.getAttribute("aria-expanded") !== "true" && !MEANT.has(event.key);
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
      if (event.key !== "Enter" && event.key !== " ") return;
      const button = event.target.closest("button, a[href], summary, input[type=checkbox], [role=button], [role=tab], [role=switch]");
      if (button && button.matches(":focus-visible")) event.stopPropagation();
    });
  });
}
