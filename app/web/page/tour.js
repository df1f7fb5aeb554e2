// The guided tour, and the lessons: a card beside what it speaks of, which is framed. The server says what it says, and to whom.
{
  const card = document.createElement("section"), frame = document.createElement("div");
  card.id = "rallyscope-tour";
  frame.id = "rallyscope-tour-frame";
  card.hidden = frame.hidden = true;
  card.setAttribute("role", "dialog");
  card.setAttribute("aria-labelledby", "rallyscope-tour-title");
  card.setAttribute("aria-describedby", "rallyscope-tour-text");
  card.innerHTML = `
    <nav aria-label="Lessons"></nav>
    <h2 id="rallyscope-tour-title"></h2>
    <p id="rallyscope-tour-text"></p>
    <p class="why"></p>
    <p class="goal" aria-live="polite"></p>
    <div class="row">
      <span></span>
      <button type="button" data-do="skip">Skip tour</button>
      <button type="button" data-do="back">Back</button>
      <button type="button" data-do="next" class="main">Next</button>
    </div>`;
  const button = (name) => card.querySelector(`[data-do=${name}]`);
  let tour = null, at = 0, before = null, ticker = 0, scrolled = null, opened = null; // `tour.kind`: "tour" or "lesson"

  // What a step speaks of: the picture, an element of ours, or the row on which its words stand.
  const textOf = (name) => {
    const texts = document.createTreeWalker(document.querySelector("#root"), NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
      const found = texts.currentNode.parentElement;
      if (texts.currentNode.nodeValue.trim() === name && found.checkVisibility() && found.getClientRects().length) return found;
    }
    return null;
  };
  const anchor = (name) => {
    if (name === "picture") return document.querySelector("#root canvas");
    if (name.startsWith("#")) return document.querySelector(name);
    let found = textOf(name);
    if (!found || found.closest("button, [role=tab]")) return found && found.closest("button, [role=tab]");
    while (found.offsetWidth < 200 && found.parentElement.offsetHeight < 60) found = found.parentElement;
    return found;
  };

  // Open, once a step, the tab or folder on which a text stands: its anchor; null without one.
  const unfold = (name) => {
    const found = name ? anchor(name) : null;
    if (!found || opened === at) return found;
    opened = at;
    if (found.matches("[role=tab]")) found.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
    else textOf(name).click();
    return found;
  };

  // Whether a person has scrolled on, so that something else is where it would be.
  const scrolledAway = (target, box) => {
    const there = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
    return !there || !(target.contains(there) || there.contains(target) || card.contains(there));
  };

  // Where the card has to end: a lesson covers neither the panel below the picture nor the time bar, which it may need.
  const floorBelow = (left, right) => Math.min(innerHeight, ...[...document.querySelectorAll("[data-rallyscope-lower], #rallyscope-bar")]
    .map((one) => one.getBoundingClientRect())
    .filter((box) => box.height && box.left < right && left < box.right)
    .map((box) => box.top));

  const place = () => {
    const found = anchor(tour.steps[at][2]), target = found || unfold(tour.steps[at][3]), width = card.offsetWidth, height = card.scrollHeight + 2;
    const isLesson = tour.kind === "lesson", isPicture = tour.steps[at][2] === "picture";
    if (found && scrolled !== at && !isPicture) { scrolled = at; found.scrollIntoView({ block: isLesson ? "center" : "nearest" }); }
    const box = target ? target.getBoundingClientRect() : null;
    frame.hidden = !box || !box.width || !box.height;
    if (isLesson && box && !isPicture && scrolledAway(target, box)) { frame.hidden = true; return; } // the card stays where it is
    const fit = (value, size, most) => Math.max(8, Math.min(value, most - size - 8));
    let left = (innerWidth - width) / 2, top = (innerHeight - height) / 2;
    if (isLesson) { left = 8; top = 40; } // what is to be done goes on beside it
    if (!frame.hidden) {
      const edge = 4;
      const shown = { left: Math.max(0, box.left - edge), top: Math.max(0, box.top - edge),
        right: Math.min(innerWidth, box.right + edge), bottom: Math.min(innerHeight, box.bottom + edge) };
      Object.assign(frame.style, { left: `${shown.left}px`, top: `${shown.top}px`,
        width: `${shown.right - shown.left}px`, height: `${shown.bottom - shown.top}px` });
      const middle = (shown.left + shown.right) / 2 - width / 2;
      if (isPicture) { left = shown.right + 8; top = innerHeight - height - 96; } // beside what moves, below the modes
      else if (shown.left > width + 20) { left = shown.left - width - 12; top = shown.top; }
      else if (shown.top > height + 20) { left = middle; top = shown.top - height - 12; }
      else if (innerHeight - shown.bottom > height + 20) { left = middle; top = shown.bottom + 12; }
      else if (innerWidth - shown.right > width + 20) { left = shown.right + 12; top = shown.top; }
      else { left = middle; top = shown.top + 12; } // it fills the window: inside, at its upper edge
    }
    left = fit(left, width, innerWidth);
    const floor = isLesson ? floorBelow(left, left + width) : innerHeight;
    Object.assign(card.style, { left: `${left}px`, top: `${fit(top, height, floor)}px`, maxHeight: `${floor - 16}px` });
  };

  const show = (number) => {
    at = number;
    const [title, text] = tour.steps[at];
    card.querySelector("h2").textContent = title;
    card.querySelector("p").textContent = text;
    showCheck();
    card.querySelector("span").textContent = `${tour.mode}, ${at + 1} of ${tour.steps.length}`;
    button("back").disabled = at === 0;
    card.hidden = false;
    place();
    if (tour.kind === "tour") button("next").focus({ preventScroll: true }); // in a lesson the keys are the app's
  };

  // What the server says of the shown lesson, and the buttons.
  const showCheck = () => {
    const last = at === tour.steps.length - 1, isLesson = tour.kind === "lesson";
    button("skip").textContent = `Skip ${tour.kind}`;
    button("skip").hidden = isLesson ? tour.done : last;
    button("next").textContent = !last ? "Next" : !isLesson ? "Done" : tour.next ? "Next lesson" : "Close";
    button("next").hidden = isLesson && last && !tour.done;
    for (const one of card.querySelectorAll("nav, .why, .goal")) one.hidden = !isLesson;
    if (!isLesson) return;
    card.querySelector(".why").textContent = tour.why;
    const goal = card.querySelector(".goal"), said = `${tour.done ? "\u2713" : "\u25cb"} ${tour.goal}${tour.so_far ? ` So far: ${tour.so_far}.` : ""}`;
    goal.classList.toggle("done", tour.done);
    if (goal.textContent !== said) goal.textContent = said;
    const listed = JSON.stringify([tour.lesson, tour.ends]), nav = card.querySelector("nav");
    if (nav.dataset.listed === listed) return;
    nav.dataset.listed = listed;
    nav.replaceChildren(...tour.ends.map(([name, end]) => {
      const one = document.createElement("button");
      Object.assign(one, { type: "button", textContent: end === "done" ? `\u2713 ${name}` : name, title: end || "to do" });
      one.dataset.to = name;
      one.dataset.end = end;
      if (name === tour.lesson) one.setAttribute("aria-current", "step");
      return one;
    }));
    const close = document.createElement("button");
    Object.assign(close, { type: "button", textContent: "\u00d7", title: "Close: progress is kept" });
    close.dataset.do = "close";
    close.setAttribute("aria-label", "Close the lessons");
    nav.append(close);
  };

  const end = (what) => {
    if (!tour) return;
    if (what) rallyscope.send(tour.kind, { do: what, number: tour.number });
    tour = null;
    card.hidden = frame.hidden = true;
    if (card.contains(document.activeElement)) document.activeElement.blur(); // hidden, it would keep the keyboard until the next frame
    clearInterval(ticker);
    if (before && before.isConnected && !before.matches("[data-rallyscope=tour], [data-rallyscope=lesson]") && // or Space would show it again, and not play
       document.activeElement === document.body) before.focus({ preventScroll: true });
  };

  const begin = (message, kind) => {
    if (tour && tour.kind !== kind) end(tour.kind === "tour" ? "done" : "close");
    if (!tour) { before = document.activeElement; ticker = setInterval(() => tour && place(), 250); }
    tour = { ...message, kind };
    scrolled = opened = null;
    show(0);
  };

  let heard = 0;
  rallyscope.handlers.tour = (message) => {
    if (message.number <= heard) return;
    heard = message.number;
    if (message.steps.length) begin(message, "tour");
    else if (tour && tour.kind === "tour") end(null);
  };
  rallyscope.handlers.lesson = (message) => {
    const shown = tour && tour.kind === "lesson";
    if (!message.lesson) { if (shown) end(null); return; }
    if (!shown || tour.lesson !== message.lesson) return begin(message, "lesson");
    Object.assign(tour, message);
    showCheck();
  };

  card.addEventListener("click", (event) => {
    const pressed = event.target.closest("button");
    if (!pressed || !tour) return;
    const last = at === tour.steps.length - 1, lesson = (what, name) => rallyscope.send("lesson", { do: what, lesson: name });
    if (pressed.dataset.do === "close") end("close");
    else if (pressed.dataset.to) lesson("to", pressed.dataset.to);
    else if (tour.kind === "lesson" && pressed.dataset.do === "skip") lesson("skip", tour.lesson);
    else if (tour.kind === "lesson" && last && pressed.dataset.do === "next") { if (tour.next) lesson("to", tour.next); else end("close"); }
    else if (pressed.dataset.do === "skip") end("skip");
    else if (pressed.dataset.do === "back") show(at - 1);
    else if (last) end("done");
    else show(at + 1);
    if (tour && tour.kind === "lesson" && event.detail) document.activeElement.blur(); // pressed with the mouse: the keys are the app's again
  });
  addEventListener("click", (event) => {
    const asked = event.target.closest && event.target.closest("[data-rallyscope=tour], [data-rallyscope=lesson]");
    if (asked) rallyscope.send(asked.dataset.rallyscope, { do: "show" });
  });
  card.addEventListener("keydown", (event) => { if (event.key !== "Escape") event.stopPropagation(); });
  addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !tour || (tour.kind === "lesson" && !card.contains(event.target)) || document.querySelector("dialog[open]")) return;
    if (event.target.closest && event.target.closest("input, textarea, select, [role=listbox], [role=combobox]")) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    end(tour.kind === "lesson" ? "close" : at === tour.steps.length - 1 ? "done" : "skip");
  }, true);

  addEventListener("DOMContentLoaded", () => document.body.append(frame, card));
  addEventListener("resize", () => tour && place());
}
