// Who draws the pictures: where no graphics card does, the processor draws every one of them, with all the rest of the page,
// and a live rally that runs on it, too, needs that time. The server then sends fewer; what moves by itself here does so less.
{
  const HAND_MS = 700, EARLY = 0.9; // a frame is due when the server's next one comes, not just after it
  let apartMs = 180;
  const drawer = () => {
    const context = document.createElement("canvas").getContext("webgl2");
    if (!context) return "software";
    const told = context.getExtension("WEBGL_debug_renderer_info");
    const name = String(context.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : context.RENDERER));
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  };

  // viser draws on for a quarter of a second after all that it is told, as often as it can: in a live rally without a rest.
  // Frames keep apart there, unless a hand is at work.
  const drawFewFrames = () => {
    const next = requestAnimationFrame.bind(window), waiting = new Map();
    let number = 0, due = false, timer = null, drawn = 0, touched = -Infinity;
    const turn = (t) => {
      due = false;
      drawn = performance.now();
      for (const id of [...waiting.keys()]) {
        const act = waiting.get(id);
        if (!act || !waiting.delete(id)) continue; // cancelled by one before it
        try { act(t); } catch (error) { reportError(error); }
      }
    };
    const go = () => { timer = null; next(turn); };
    window.requestAnimationFrame = (act) => {
      waiting.set(++number, act);
      if (!due) {
        const now = performance.now(), rests = rallyscope.rallyRuns && now - touched > HAND_MS;
        due = true;
        if (rests && drawn + apartMs > now) timer = setTimeout(go, drawn + apartMs - now);
        else go();
      }
      return number;
    };
    window.cancelAnimationFrame = (id) => { waiting.delete(id); };
    const touch = () => {
      touched = performance.now();
      if (timer !== null) { clearTimeout(timer); go(); }
    };
    for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"]) addEventListener(kind, touch, { capture: true, passive: true });
  };

  rallyscope.handlers.apart = (message) => { apartMs = EARLY * 1000 * message.seconds; };
  rallyscope.bySoftware = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(drawer());
  if (rallyscope.bySoftware) drawFewFrames();
  const found = rallyscope.onFound;
  rallyscope.onFound = () => { found(); rallyscope.send("drawing", { software: rallyscope.bySoftware }); };
}
