// The panel below the picture: as wide as the picture, and as high as a person drags its upper edge. The height is kept in
// this browser, and the server, which frames the picture above the panel, is sent what the panel takes.
{
  const KEPT = "rallyscope-lower-px";
  const LEAST_PX = 100, BAR_PX = 86, PICTURE_PX = 160; // what stays for the time bar with its gap, and for the picture
  const LAST_TAB = "Keys"; // of every panel that stands there
  const SEND_MS = 80;

  const usual = () => 0.22 * innerHeight;
  const within = (px) => Math.round(Math.max(LEAST_PX, Math.min(px, innerHeight - BAR_PX - PICTURE_PX)));
  const kept = () => {
    try { return Number(localStorage.getItem(KEPT)) || 0; } catch { return 0; } // a browser that keeps nothing
  };
  const keep = (px) => {
    try { if (px) localStorage.setItem(KEPT, px); else localStorage.removeItem(KEPT); } catch { /* as above */ }
  };
  let wanted = kept(); // 0: the usual height
  const apply = () => document.documentElement.style.setProperty("--rallyscope-lower", `${within(wanted || usual())}px`);

  let sent = null, timer = null;
  const tell = () => {
    timer = null;
    const panel = document.querySelector("[data-rallyscope-lower]");
    if (!panel || panel.offsetHeight === sent) return;
    sent = panel.offsetHeight;
    rallyscope.send("lower", { height: sent });
  };
  const tellSoon = () => { timer ??= setTimeout(tell, SEND_MS); };
  const sizes = new ResizeObserver(tellSoon);

  const isLower = (panel) => [...panel.querySelectorAll("[data-dock-tab]")].some((tab) => tab.textContent.trim() === LAST_TAB);
  const find = () => {
    for (const panel of document.querySelectorAll("[data-floating-window]:not([data-rallyscope-lower])")) {
      if (!isLower(panel)) continue;
      panel.dataset.rallyscopeLower = "";
      panel.querySelector("[data-dock-griphandle]")?.setAttribute("title", "Drag to resize. Double-click: usual height");
      sizes.observe(panel);
    }
  };

  // viser would move the panel, over the picture, where a person takes it at its top.
  const taken = (event) => {
    const at = event.target instanceof Element ? event.target : null, panel = at?.closest("[data-rallyscope-lower]");
    if (!panel || event.button !== 0 || at.closest("button, [role=button], [data-dock-tab], [data-dock-minimize]")) return null;
    const isOpen = panel.style.flexDirection === "column";
    return isOpen && at.closest("[data-dock-griphandle], [data-dock-strip], [data-dock-resize=top]") ? panel : null;
  };
  addEventListener("pointerdown", (event) => {
    const panel = taken(event);
    if (!panel) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const from = event.clientY, height = panel.offsetHeight;
    const move = (now) => {
      if (now.pointerId !== event.pointerId || Math.abs(now.clientY - from) < 3) return;
      wanted = within(height + from - now.clientY);
      apply();
    };
    const end = (now) => {
      if (now.pointerId !== event.pointerId) return;
      for (const [kind, act] of [["pointermove", move], ["pointerup", end], ["pointercancel", end]]) removeEventListener(kind, act, true);
      delete panel.dataset.rallyscopeResizing;
      keep(wanted);
    };
    panel.dataset.rallyscopeResizing = "";
    for (const [kind, act] of [["pointermove", move], ["pointerup", end], ["pointercancel", end]]) addEventListener(kind, act, true);
  }, true);
  addEventListener("dblclick", (event) => {
    if (!taken(event)) return;
    wanted = 0;
    keep(0);
    apply();
  }, true);

  const found = rallyscope.onFound;
  rallyscope.onFound = () => { found(); sent = null; tellSoon(); };
  addEventListener("resize", apply);
  addEventListener("DOMContentLoaded", () => {
    apply();
    new MutationObserver(find).observe(document.body, { childList: true, subtree: true });
  });
}
