// viser's controls stand beside their labels without being tied to them, and its buttons with a picture have no name: for
// a screen reader every one gets it here, whenever the panels have changed. What can be scrolled can be scrolled by keys.
{
  const ICONS = {
    "x": "Close", "adjustments": "Settings of the view", "arrow-back": "Back to the controls", "share": "Share",
    "chevron-down": "Open", "chevron-up": "Close", "keyboard": "Commands",
  };

  const rowOf = (label) => {
    const control = document.getElementById(label.htmlFor);
    let row = label.parentElement;
    for (let up = 0; row && up < 6; up += 1, row = row.parentElement) {
      if (control ? row.contains(control) : row.querySelector("input, [role=slider], button")) return row;
    }
    return control;
  };

  const nameRow = (label) => {
    const text = label.textContent.trim();
    const nameless = [...(rowOf(label)?.querySelectorAll("input, textarea, [role=slider]") ?? [])]
      .filter((field) => field.id !== label.htmlFor && field.type !== "hidden" && !field.closest("[data-rallyscope]"));
    nameless.forEach((field, at) => {
      const name = nameless.length > 1 && !nameless.some((one) => one.role === "slider") ? `${text} ${at + 1}` : text;
      if (field.getAttribute("aria-label") !== name) field.setAttribute("aria-label", name);
    });
  };

  const nameButton = (button) => {
    if (button.textContent.trim() || button.getAttribute("aria-label") || button.title) return;
    const icon = /tabler-icon-([a-z-]+)/.exec(button.querySelector("svg")?.getAttribute("class") ?? "")?.[1];
    const closes = /CloseButton/.test(button.className);
    button.setAttribute("aria-label", closes ? "Close" : ICONS[icon] ?? (icon ?? "Button").replaceAll("-", " "));
  };

  const nameAll = () => {
    document.querySelectorAll("label[for]").forEach(nameRow);
    document.querySelectorAll("button").forEach(nameButton);
    document.querySelectorAll("[data-scrollarea-viewport]:not([tabindex])").forEach((area) => { area.tabIndex = 0; });
  };

  let due = false;
  const soon = () => {
    if (due) return;
    due = true;
    setTimeout(() => { due = false; nameAll(); }, 400);
  };
  addEventListener("DOMContentLoaded", () => {
    new MutationObserver(soon).observe(document.body, { childList: true, subtree: true });
    soon();
  });
}
