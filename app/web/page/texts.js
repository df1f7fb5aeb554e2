// Words on the pictures, in real letters: sharp at every zoom, and never over each other.
{
  const layer = document.createElement("div");
  layer.id = "rallyscope-texts";
  layer.setAttribute("aria-hidden", "true"); // the tables beside the pictures say the same
  let texts = [], place = null, spans = [];

  const overlap = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

  const draw = () => {
    const pictures = document.querySelector("#root canvas");
    if (!pictures || !place) return;
    const box = pictures.getBoundingClientRect(), scale = box.height / place.height;
    Object.assign(layer.style, { left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` });
    const taken = [];
    spans.forEach((span, number) => {
      const [x, y, , , isTitle] = texts[number], width = span.offsetWidth, height = span.offsetHeight;
      const left = Math.min(Math.max(2, box.width / 2 + (x - place.x) * scale), box.width - width - 2);
      let top = box.height / 2 + (y - place.y) * scale - (isTitle ? height / 2 : height);
      const at = () => ({ left, right: left + width, top, bottom: top + height });
      for (let tries = 0, up = !isTitle; tries < 24; tries++) { // above what is in the way: below is the thing itself
        const other = taken.find((one) => overlap(at(), one));
        if (!other) break;
        top = up ? other.top - height - 1 : other.bottom + 1;
        if (top < 0) { up = false; top = 0; }
      }
      taken.push(at());
      span.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
    });
  };

  rallyscope.handlers.texts = (message) => {
    texts = message.texts.sort((one, other) => other[4] - one[4]);
    while (spans.length > texts.length) spans.pop().remove();
    texts.forEach(([, , text, colour], number) => {
      let span = spans[number];
      if (!span) layer.append((span = spans[number] = document.createElement("span")));
      if (span.textContent !== text) span.textContent = text;
      span.style.color = colour;
    });
    draw();
  };
  rallyscope.handlers.place = (message) => { place = message; draw(); };

  addEventListener("DOMContentLoaded", () => {
    document.body.append(layer);
    addEventListener("resize", draw);
    document.fonts.addEventListener("loadingdone", draw); // letters of another font have another width
    const watch = () => {
      const pictures = document.querySelector("#root canvas");
      if (pictures) new ResizeObserver(draw).observe(pictures); else setTimeout(watch, 200);
    };
    watch();
  });
}
