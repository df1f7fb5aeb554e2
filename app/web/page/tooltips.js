// A hint stands at the left of the panel of its control, where it covers neither the control nor the one above; it goes
// with a click on the control, and comes again when the mouse has left that.
{
  const GAP_PX = 10, EDGE_PX = 4;
  const HINT = "[class*=mantine-Tooltip-tooltip]";

  const place = (hint) => {
    const control = hint.id && document.querySelector(`[aria-describedby~="${CSS.escape(hint.id)}"]`);
    if (!control) return;
    hint.style.translate = "none"; // on top of the place that viser's page gives it
    const at = control.getBoundingClientRect(), now = hint.getBoundingClientRect();
    const panel = control.closest("[data-dock-region], [data-floating-window]")?.getBoundingClientRect() ?? at;
    const isLeft = panel.left > innerWidth / 2;
    const x = isLeft ? panel.left - now.width - GAP_PX : panel.right + GAP_PX;
    if (panel.width > innerWidth / 2 || x < EDGE_PX || x + now.width > innerWidth - EDGE_PX) return; // as it was
    const y = Math.min(Math.max(at.top + at.height / 2 - now.height / 2, EDGE_PX), innerHeight - now.height - EDGE_PX);
    hint.style.translate = `${x - now.left}px ${y - now.top}px`;
  };

  addEventListener("DOMContentLoaded", () => {
    new MutationObserver((changes) => {
      for (const { addedNodes } of changes)
        for (const node of addedNodes) {
          const hint = node instanceof Element && (node.matches(HINT) ? node : node.querySelector(HINT));
          if (hint) requestAnimationFrame(() => place(hint)); // after viser's page has placed it
        }
    }).observe(document.body, { childList: true, subtree: true });
  });

  let clicked = null;
  addEventListener("pointerdown", (event) => {
    clicked = event.target instanceof Element ? event.target : null;
    document.documentElement.toggleAttribute("data-rallyscope-clicked", true);
  }, true);
  addEventListener("pointerover", (event) => {
    if (!clicked || !(event.target instanceof Element) || clicked.contains(event.target) || event.target.contains(clicked)) return;
    clicked = null;
    document.documentElement.toggleAttribute("data-rallyscope-clicked", false);
  }, true);
}
