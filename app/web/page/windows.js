// viser's windows over the page close by their buttons only. Enter in a field is the first of them, Escape the last: each
// window of ours has what it asks for first, and the way out last.
{
  const FIELD = "input:not([type=checkbox])";
  let pressing = null;

  const buttonsOf = (over) => [...over.querySelectorAll("button")].filter((button) => button.offsetParent && !button.disabled);
  // viser's own know Escape: a picture in large has a cross, and Share has a name.
  const isOurs = (over) =>
    !over.querySelector("[class*=mantine-Modal-close]") && over.querySelector("[class*=mantine-Modal-title]")?.textContent !== "Share";

  const press = (button) => {
    pressing = null;
    if (button.isConnected) button.click();
  };

  const opened = new WeakSet(); // what such a window offers in its first field is replaced by what is typed at once
  addEventListener("focusin", (event) => {
    const over = event.target instanceof Element && event.target.closest("[class*=mantine-Modal-content]");
    if (!over || opened.has(over) || !event.target.matches(FIELD) || !isOurs(over)) return;
    opened.add(over);
    event.target.select();
  });

  const entered = new WeakSet(); // a window whose fields come a moment after it takes the keyboard itself, and would keep it
  const enterField = (over) => {
    const field = over.querySelector(FIELD);
    if (field && document.activeElement === over) field.focus();
    return field !== null || document.activeElement !== over;
  };
  addEventListener("focusin", ({ target: over }) => {
    if (!(over instanceof Element) || !over.matches("[class*=mantine-Modal-content]") || entered.has(over) || !isOurs(over)) return;
    entered.add(over);
    if (enterField(over)) return;
    const arriving = new MutationObserver(() => { if (!over.isConnected || enterField(over)) arriving.disconnect(); });
    arriving.observe(over, { childList: true, subtree: true });
  });

  addEventListener("keydown", (event) => {
    if (event.isComposing || event.ctrlKey || event.metaKey || event.altKey) return;
    const over = [...document.querySelectorAll("[class*=mantine-Modal-content]")].at(-1);
    if (!over || !isOurs(over)) return;
    const field = over.querySelector(FIELD), isOutside = !over.contains(event.target); // it takes the keyboard a moment after it is seen
    if (isOutside && field && [...event.key].length === 1) {
      field.focus(); // now, so that this letter is typed there and is no key of the app
      event.stopImmediatePropagation();
      return;
    }
    const isTyping = isOutside ? field !== null : event.target.matches("input");
    const number = event.key === "Escape" ? -1 : event.key === "Enter" && isTyping ? 0 : null;
    const button = number === null ? null : buttonsOf(over).at(number);
    if (!button) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    clearTimeout(pressing);
    pressing = setTimeout(press, 0, button);
  }, true);
}
