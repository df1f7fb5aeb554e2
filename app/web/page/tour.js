// The guided tour: a card beside what it speaks of, which is framed. The server says what it says, and to whom.
{
  const card = document.createElement("section"), frame = document.createElement("div");
  card.id = "rallyscope-tour";
  frame.id = "rallyscope-tour-frame";
  card.hidden = frame.hidden = true;
  card.setAttribute("role", "dialog");
  card.setAttribute("aria-labelledby", "rallyscope-tour-title");
  card.setAttribute("aria-describedby", "rallyscope-tour-text");
  card.innerHTML = `
    <h2 id="rallyscope-tour-title"></h2>
    <p id="rallyscope-tour-text"></p>
    <div class="row">
      <span></span>
      <button type="button" data-do="skip">Skip tour</button>
      <button type="button" data-do="back">Back</button>
      <button type="button" data-do="next" class="main">Next</button>
    </div>`;
  const button = (name) => card.querySelector(`[data-do=${name}]`);
  let tour = null, at = 0, before = null, ticker = 0, scrolled = null;

  // What a step speaks of: the picture, an element of ours, or the row on which its words stand.
  const anchor = (name) => {
    if (name === "picture") return document.querySelector("#root canvas");
    if (name.startsWith("#")) return document.querySelector(name);
    const texts = document.createTreeWalker(document.querySelector("#root"), NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
      if (texts.currentNode.nodeValue.trim() !== name) continue;
      let found = texts.currentNode.parentElement;
      if (!found.checkVisibility() || !found.getClientRects().length) continue;
      if (found.closest("button, [role=tab]")) return found.closest("button, [role=tab]");
      while (found.offsetWidth < 200 && found.parentElement.offsetHeight < 60) found = found.parentElement;
      return found;
    }
    return null;
  };

  const place = () => {
    const target = anchor(tour.steps[at][2]), width = card.offsetWidth, height = card.offsetHeight;
    if (target && scrolled !== at && tour.steps[at][2] !== "picture") { scrolled = at; target.scrollIntoView({ block: "nearest" }); }
    const box = target ? target.getBoundingClientRect() : null;
    frame.hidden = !box || !box.width || !box.height;
    const fit = (value, size, most) => Math.max(8, Math.min(value, most - size - 8));
    let left = (innerWidth - width) / 2, top = (innerHeight - height) / 2;
    if (!frame.hidden) {
      const edge = 4;
      const shown = { left: Math.max(0, box.left - edge), top: Math.max(0, box.top - edge),
        right: Math.min(innerWidth, box.right + edge), bottom: Math.min(innerHeight, box.bottom + edge) };
      Object.assign(frame.style, { left: `${shown.left}px`, top: `${shown.top}px`,
        width: `${shown.right - shown.left}px`, height: `${shown.bottom - shown.top}px` });
      const middle = (shown.left + shown.right) / 2 - width / 2;
      if (tour.steps[at][2] === "picture") { left = shown.right + 8; top = innerHeight - height - 96; } // beside what moves, below the modes
      else if (shown.left > width + 20) { left = shown.left - width - 12; top = shown.top; }
      else if (shown.top > height + 20) { left = middle; top = shown.top - height - 12; }
      else if (innerHeight - shown.bottom > height + 20) { left = middle; top = shown.bottom + 12; }
      else if (innerWidth - shown.right > width + 20) { left = shown.right + 12; top = shown.top; }
      else { left = middle; top = shown.top + 12; } // it fills the window: inside, at its upper edge
    }
    Object.assign(card.style, { left: `${fit(left, width, innerWidth)}px`, top: `${fit(top, height, innerHeight)}px` });
  };

  const show = (number) => {
    at = number;
    const [title, text] = tour.steps[at], last = at === tour.steps.length - 1;
    card.querySelector("h2").textContent = title;
    card.querySelector("p").textContent = text;
    card.querySelector("span").textContent = `${tour.mode}, ${at + 1} of ${tour.steps.length}`;
    button("back").disabled = at === 0;
    button("next").textContent = last ? "Done" : "Next";
    button("skip").hidden = last;
    card.hidden = false;
    place();
    button("next").focus({ preventScroll: true });
  };

  const end = (what) => {
    if (!tour) return;
    if (what) rallyscope.send("tour", { do: what, number: tour.number });
    tour = null;
    card.hidden = frame.hidden = true;
    if (card.contains(document.activeElement)) document.activeElement.blur(); // hidden, it would keep the keyboard until the next frame
    clearInterval(ticker);
    if (before && before.isConnected && !before.matches("[data-rallyscope=tour]") && // or Space would show it again, and not play
       document.activeElement === document.body) before.focus({ preventScroll: true });
  };

  let heard = 0;
  rallyscope.handlers.tour = (message) => {
    if (message.number <= heard) return;
    heard = message.number;
    const running = tour !== null;
    if (!message.steps.length) return end(null);
    tour = message;
    scrolled = null;
    if (!running) { before = document.activeElement; ticker = setInterval(() => tour && place(), 250); }
    show(0);
  };

  card.addEventListener("click", (event) => {
    const pressed = event.target.closest("button");
    if (!pressed || !tour) return;
    const last = at === tour.steps.length - 1;
    if (pressed.dataset.do === "skip") end("skip");
    else if (pressed.dataset.do === "back") show(at - 1);
    else if (last) end("done");
    else show(at + 1);
  });
  addEventListener("click", (event) => {
    if (event.target.closest && event.target.closest("[data-rallyscope=tour]")) rallyscope.send("tour", { do: "show" });
  });
  card.addEventListener("keydown", (event) => { if (event.key !== "Escape") event.stopPropagation(); });
  addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !tour || document.querySelector("dialog[open]")) return;
    if (event.target.closest && event.target.closest("input, textarea, select, [role=listbox], [role=combobox]")) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    end(at === tour.steps.length - 1 ? "done" : "skip");
  }, true);

  addEventListener("DOMContentLoaded", () => document.body.append(frame, card));
  addEventListener("resize", () => tour && place());
}
