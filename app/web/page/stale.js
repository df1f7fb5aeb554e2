// What is not the answer to what is asked now is grey: the picture with its words and the reason, all that a panel marks,
// and the cameras' pictures beside the 3D view, which are asked for apart (`docked`).
{
  const badge = document.createElement("div");
  badge.id = "rallyscope-stale";
  badge.setAttribute("role", "status");
  badge.hidden = true;
  const TEXTS = {
    computing: "Computing ...",
    compiling: "Compiling ... (once, on first use)",
    failed: "No answer: see the message",
  };

  const place = () => {
    const pictures = document.querySelector("#root canvas");
    if (!pictures || badge.hidden) return;
    const box = pictures.getBoundingClientRect();
    Object.assign(badge.style, { left: `${box.left + box.width / 2}px`, top: `${box.top + 14}px` });
  };

  rallyscope.handlers.stale = ({ why, docked }) => {
    if (docked !== undefined) { document.documentElement.toggleAttribute("data-rallyscope-stale-docked", Boolean(docked)); return; }
    document.documentElement.toggleAttribute("data-rallyscope-stale", Boolean(why));
    badge.textContent = TEXTS[why] || "";
    badge.hidden = !why;
    place();
  };

  addEventListener("DOMContentLoaded", () => document.body.append(badge));
  addEventListener("resize", place);
}
