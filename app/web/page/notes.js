// A note lies over the picture and goes away by itself. A click that was meant for its cross, and comes when it has just
// gone, is not meant for the picture: in Label it would be a label. A note that lets clicks through was never clicked on.
{
  const GONE_MS = 1200, LOOK_MS = 150;
  const NOTE = "[class*=mantine-Notification-root]";
  let places = []; // { box, seen } of the notes of late
  let swallows = false, timer = null;

  const boxes = () =>
    [...document.querySelectorAll(NOTE)]
      .filter((note) => getComputedStyle(note).pointerEvents !== "none")
      .map((note) => note.getBoundingClientRect());
  const look = () => {
    const now = performance.now();
    places = places.filter((place) => now - place.seen < GONE_MS);
    places.push(...boxes().map((box) => ({ box, seen: now })));
    timer = places.length ? setTimeout(look, LOOK_MS) : null;
  };
  const soon = () => { timer ??= setTimeout(look, LOOK_MS); };
  const lies = (box, event) =>
    box.left <= event.clientX && event.clientX <= box.right && box.top <= event.clientY && event.clientY <= box.bottom;

  const swallow = (event) => {
    if (event.type === "pointerdown") {
      const now = performance.now();
      const isPicture = event.target instanceof Element && event.target.closest("#root canvas");
      const wasThere = places.some((place) => now - place.seen < GONE_MS && lies(place.box, event));
      swallows = Boolean(isPicture) && wasThere && !boxes().some((box) => lies(box, event));
    }
    if (!swallows) return;
    event.stopImmediatePropagation();
    event.preventDefault();
  };
  for (const kind of ["pointerdown", "mousedown", "pointerup", "mouseup", "click", "dblclick"]) addEventListener(kind, swallow, true);
  addEventListener("DOMContentLoaded", () => new MutationObserver(soon).observe(document.body, { childList: true, subtree: true }));
}
