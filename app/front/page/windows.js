// viser's windows over the page close by their buttons only. Enter in a field is the first of them, Escape the last: each
// window of ours has what it asks for first, and the way out last.
{
  const buttonsOf = (over) => [...over.querySelectorAll("button")].filter((button) => button.offsetParent && !button.disabled);

  addEventListener("keydown", (event) => {
    if (event.isComposing || event.ctrlKey || event.metaKey || event.altKey) return;
    const over = [...document.querySelectorAll("[class*=mantine-Modal-content]")].at(-1);
    if (!over) return;
    const isTyping = over.contains(event.target) && event.target.matches("input");
    const number = event.key === "Escape" ? -1 : event.key === "Enter" && isTyping ? 0 : null;
    const button = number === null ? null : buttonsOf(over).at(number);
    if (!button) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    button.click();
  }, true);
}
