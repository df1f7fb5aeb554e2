// viser sends a field with every letter, at most every 50 ms, and a click on a button at once. So a number would be judged
// while it is half typed (the 5 of 500), and a name could reach the server after the button that takes it. What is typed is
// therefore held back until there is a pause, Enter, or the cursor leaves the field: one message, before any click.
{
  const PAUSE_MS = 600;
  const FIELDS = "input[class*=mantine-NumberInput], input[class*=mantine-TextInput], textarea[class*=mantine-Textarea]";
  let held = null; // { field, timer } of what viser has not heard yet
  let passing = false;

  const flush = () => {
    if (!held) return;
    const { field, timer } = held;
    held = null;
    clearTimeout(timer);
    passing = true;
    field.dispatchEvent(new InputEvent("input", { bubbles: true }));
    passing = false;
  };

  addEventListener("input", (event) => {
    const field = event.target;
    if (passing || !(field instanceof Element) || !field.matches(FIELDS)) return;
    event.stopImmediatePropagation();
    if (held && held.field !== field) flush();
    clearTimeout(held?.timer);
    held = { field, timer: setTimeout(flush, PAUSE_MS) };
  }, true);
  for (const kind of ["change", "focusout"]) addEventListener(kind, flush, true);
  addEventListener("pointerdown", (event) => { if (event.target !== held?.field) flush(); }, true);
  addEventListener("keydown", (event) => {
    if (!(event.target instanceof Element)) return;
    const isNumber = event.target.matches("input[class*=mantine-NumberInput]");
    // The box takes where the cursor was at the last key for the place of the change, which is now that of several.
    if (isNumber && !event.ctrlKey && !event.metaKey && /^(.|Backspace|Delete)$/.test(event.key)) event.stopImmediatePropagation();
    if (/^(Tab|Enter|Escape|ArrowUp|ArrowDown)$/.test(event.key)) flush();
    // A box brings a number inside its bounds when it is left; Enter says as clearly that it is meant.
    if (event.key === "Enter" && isNumber) event.target.blur();
  }, true);
}
