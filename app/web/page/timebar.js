// The bar under the picture: transport, and the time line. The server says what there is; the page draws it.
{
  const icon = (path) => `<svg viewBox="0 0 16 16" width="14" height="14" aria-hidden="true"><path d="${path}"/></svg>`;
  const ICONS = {
    start: icon("M3 3h2v10H3zM13 3v10L6 8z"), end: icon("M11 3h2v10h-2zM3 3v10l7-5z"),
    play: icon("M4 2.5v11l9-5.5z"), pause: icon("M4 3h3v10H4zM9 3h3v10H9z"),
    previous: icon("M10.5 2.5 5 8l5.5 5.5-1.5 1.2L2.5 8 9 1.3z"), next: icon("M5.5 2.5 11 8l-5.5 5.5L7 14.7 13.5 8 7 1.3z"),
    mark: icon("M3 2h2v12H3zM5 2h8l-2.500 3L13 8H5z"), loop: icon("M3 3 8 6.600 13 3l1 1.400L9.500 8l4.500 3.600L13 13 8 9.400 3 13l-1-1.400L6.500 8 2 4.400z"),
  };
  const bar = document.createElement("div");
  bar.id = "rallyscope-bar";
  bar.hidden = true;
  bar.innerHTML = `
    <div class="row">
      <button data-do="start" title="To the start (Home)" aria-label="To the start">${ICONS.start}</button>
      <button data-do="back10" title="Ten steps back (Shift+←)" aria-label="-10">-10</button>
      <button data-do="back" title="One step back (←)" aria-label="-1">-1</button>
      <button data-do="play" class="main" title="Play or pause (Space or K)" aria-label="Play">${ICONS.play}</button>
      <button data-do="on" title="One step on (→)" aria-label="+1">+1</button>
      <button data-do="on10" title="Ten steps forward (Shift+→)" aria-label="+10">+10</button>
      <button data-do="end" title="To the end (End)" aria-label="To the end">${ICONS.end}</button>
      <label><span class="word">Time</span> <input id="rallyscope-time" autocomplete="off" title="h:mm:ss.mmm, seconds with a point (1.25), or whole microseconds"></label>
      <span id="rallyscope-us"></span>
      <label>Speed <select id="rallyscope-speed"></select></label>
      <label>Step <select id="rallyscope-step"></select></label>
      <button data-do="previous" title="To the previous mark, bounce, hit or miss ([)" aria-label="Previous mark">${ICONS.previous}</button>
      <button data-do="mark" title="Mark this moment, or remove its mark (')" aria-label="Mark this moment">${ICONS.mark}</button>
      <button data-do="next" title="To the next mark, bounce, hit or miss (])" aria-label="Next mark">${ICONS.next}</button>
      <button data-do="loop" title="Stop repeating; Shift and drag along the line to repeat a section" aria-label="Stop repeating" hidden>${ICONS.loop}</button>
      <span id="rallyscope-legend"></span>
    </div>
    <canvas id="rallyscope-line" tabindex="0" role="slider" aria-label="Time line"></canvas>
    <div id="rallyscope-tip" role="tooltip" hidden></div>`;
  const find = (selector) => bar.querySelector(selector);
  const canvas = find("canvas"), tip = find("#rallyscope-tip"), time = find("#rallyscope-time");
  const button = (name) => find(`[data-do=${name}]`);
  const ask = (what, value) => rallyscope.send("bar", { do: what, value });

  const COLOURS = {
    bounce: "#7fd4ff", hit: "#ff8c28", net: "#ff6fae", mark: "#ffffff",
    found: "#3fb27f", missed: "#e8590c", false: "#f2c037",
    visible: "#5bffb6", partly_occluded: "#dcd653", occluded: "#d9703b", out_of_frame: "#5a96e6", no_ball: "#9698a0",
  };
  const RATES = ["#ff8c28", "#5096ff", "#6eeb82", "#e6a0ff"];
  let now = null, heard = 0; // the latest message, and when it came
  let tracks = { duration: 0, rates: {}, moments: {}, runs: {}, contacts: [], top_hz: 0 };
  let view = null; // what part of the recording is spread over the line; null: all of it
  let hover = null, drag = null;

  const range = () => (now.live ? [now.start, now.end] : view || [0, now.end]);
  const position = () => {
    if (!now.playing || now.following) return now.now;
    let t = now.now + (performance.now() - heard) * 1000 * now.speed;
    if (now.loop && now.now >= now.loop[0] && now.now < now.loop[1] && t >= now.loop[1])
      t = now.loop[0] + ((t - now.loop[0]) % (now.loop[1] - now.loop[0]));
    return Math.min(t, now.end);
  };
  const toX = (t) => { const [a, b] = range(); return ((t - a) / (b - a)) * canvas.clientWidth; };
  const toTime = (x) => { const [a, b] = range(); return Math.round(a + (x / canvas.clientWidth) * (b - a)); };
  const words = (name) => name.replaceAll("_", " ");
  const clock = (t) => { // h:mm:ss.mmm, µs rounded down
    const ms = Math.floor(t / 1000), two = (value) => String(value).padStart(2, "0");
    return `${Math.floor(ms / 3_600_000)}:${two(Math.floor(ms / 60_000) % 60)}:${two(Math.floor(ms / 1000) % 60)}.${String(ms % 1000).padStart(3, "0")}`;
  };
  const micros = (t) => `${t} µs`;
  const timeOf = (text) => { // µs; NaN if it is no time
    const clean = text.trim().replace(",", ".");
    if (/^\d+$/.test(clean)) return Number(clean);
    const found = /^(?:(?:(\d+):)?([0-5]?\d):)?(\d+)(\.\d{1,6})?$/.exec(clean);
    if (!found || (found[2] && Number(found[3]) > 59)) return NaN;
    const [, hours = 0, minutes = 0, whole, part = ""] = found;
    return ((Number(hours) * 60 + Number(minutes)) * 60 + Number(whole)) * 1e6 + Number(part.slice(1).padEnd(6, "0"));
  };

  // Drawing ---------------------------------------------------------------------------------------------------

  const drawRates = (pen, width, top, height) => {
    Object.values(tracks.rates).forEach((rate, number) => {
      pen.beginPath();
      rate.forEach((value, bin) => {
        const x = toX(((bin + 0.5) / rate.length) * tracks.duration), y = top + height * (1 - value / 255);
        if (bin) pen.lineTo(x, y); else pen.moveTo(x, y);
      });
      pen.strokeStyle = RATES[number % RATES.length];
      pen.lineWidth = 1;
      pen.globalAlpha = 0.85;
      pen.stroke();
      pen.globalAlpha = 1;
    });
  };

  const drawRuns = (pen, top) => {
    Object.entries(tracks.runs).forEach(([, runs], row) => {
      for (const [start, end, kind] of runs) {
        pen.fillStyle = COLOURS[kind] || "#888";
        const x = toX(start);
        pen.fillRect(x, top + 6 * row, Math.max(1.2, toX(end) - x), 5);
      }
    });
  };

  const drawMoment = (pen, x, y, kind, apart = false) => {
    pen.fillStyle = COLOURS[kind] || "#ccc";
    pen.beginPath();
    if (kind === "hit") { pen.moveTo(x, y - 4); pen.lineTo(x + 4, y); pen.lineTo(x, y + 4); pen.lineTo(x - 4, y); }
    else if (kind === "mark") { pen.rect(x - 1, y - 6, 2, 12); pen.rect(x, y - 6, 7, 5); }
    else if (kind === "net") pen.rect(x - 3, y - 3, 6, 6);
    else { pen.moveTo(x - 4, y - 3); pen.lineTo(x + 4, y - 3); pen.lineTo(x, y + 4); }
    pen.closePath();
    if (apart) pen.stroke(); // from the curves behind it
    pen.fill();
  };

  const drawContact = (pen, [t, sigma, kind, proposed]) => { // labelled, or pale: proposed
    const x = toX(t), y = 20, reach = toX(t + sigma) - x;
    pen.globalAlpha = proposed ? 0.4 : 1;
    pen.fillStyle = COLOURS[kind];
    pen.fillRect(x - reach, y - 0.5, 2 * reach, 1); // its standard deviation
    pen.strokeStyle = "#14161a";
    pen.lineWidth = 3;
    drawMoment(pen, x, y, kind, true);
    pen.globalAlpha = 1;
  };

  const draw = () => {
    const width = canvas.clientWidth, height = canvas.clientHeight, dense = devicePixelRatio || 1;
    if (!now || !width) return;
    if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) {
      canvas.width = Math.round(width * dense);
      canvas.height = Math.round(height * dense);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(dense, 0, 0, dense, 0, 0);
    pen.clearRect(0, 0, width, height);
    const loop = drag && drag.loop ? [drag.from, drag.to].sort((a, b) => a - b) : now.loop;
    if (loop) {
      pen.fillStyle = "rgba(255, 140, 40, .22)";
      pen.fillRect(toX(loop[0]), 0, Math.max(1, toX(loop[1]) - toX(loop[0])), height);
    }
    const lines = Object.keys(tracks.runs).length;
    drawRuns(pen, height - 6 * lines);
    drawRates(pen, width, 14, height - 6 * lines - 16);
    for (const [kind, times] of Object.entries(tracks.moments)) for (const t of times) drawMoment(pen, toX(t), 7, kind);
    for (const contact of tracks.contacts) drawContact(pen, contact);
    for (const t of now.marks) drawMoment(pen, toX(t), 7, "mark");
    const x = toX(position());
    pen.fillStyle = "#fff";
    pen.fillRect(x - 0.75, 0, 1.5, height);
    if (hover !== null) { pen.fillStyle = "rgba(255,255,255,.35)"; pen.fillRect(hover - 0.5, 0, 1, height); }
  };

  let drawnAt = 0;
  const turn = () => { // only while something moves
    if (now && now.playing && !bar.hidden) {
      if (performance.now() - drawnAt > 30) { drawnAt = performance.now(); draw(); showTime(); }
      setTimeout(turn, 33);
    } else turning = false;
  };
  let turning = false;

  const showTime = () => {
    const t = Math.round(position());
    if (document.activeElement !== time) time.value = clock(t);
    find("#rallyscope-us").textContent = micros(t);
    canvas.setAttribute("aria-valuemin", Math.round(range()[0]));
    canvas.setAttribute("aria-valuemax", Math.round(range()[1]));
    canvas.setAttribute("aria-valuenow", t);
    canvas.setAttribute("aria-valuetext", `${clock(t)}, ${micros(t)}`);
  };

  const fill = (select, options, chosen) => {
    if (select.options.length !== options.length)
      select.replaceChildren(...options.map(([value, label]) => new Option(label, value)));
    if (document.activeElement !== select) select.value = chosen;
  };

  const showLegend = () => {
    const kinds = new Set([...Object.keys(tracks.moments).filter((kind) => tracks.moments[kind].length)]);
    for (const runs of Object.values(tracks.runs)) for (const [, , kind] of runs) kinds.add(kind);
    for (const [, , kind] of tracks.contacts) kinds.add(kind);
    const legend = Object.keys(tracks.rates).map((name, number) => [name, RATES[number % RATES.length]]);
    for (const kind of kinds) legend.push([words(kind), COLOURS[kind] || "#888"]);
    find("#rallyscope-legend").title = legend.map(([name]) => name).join(", ");
    find("#rallyscope-legend").replaceChildren(...legend.map(([name, colour]) => {
      const item = document.createElement("span");
      item.textContent = name;
      item.style.setProperty("--dot", colour);
      return item;
    }));
    fitLegend();
  };

  const fitLegend = () => { // the last ones are left out where there is no room for all
    const legend = find("#rallyscope-legend"), items = [...legend.children], fits = () => legend.scrollHeight <= legend.clientHeight;
    for (const item of items) item.hidden = false;
    legend.removeAttribute("data-more");
    for (let left = items.length - 1; left > 0 && !fits(); left--) {
      items[left].hidden = true;
      legend.dataset.more = `+${items.length - left}`;
    }
  };

  const place = () => { // over the lower edge of viser's picture, whatever panels stand beside it
    const pictures = document.querySelector("#root canvas");
    if (!pictures) return;
    const box = pictures.getBoundingClientRect();
    bar.style.left = `${box.left}px`;
    if (bar.style.width !== `${box.width}px`) {
      bar.style.width = `${box.width}px`;
      fitLegend();
    }
    draw();
  };

  rallyscope.handlers.bar = (message) => {
    const first = !now;
    if (now && (message.end !== now.end || message.live !== now.live) && !message.live) view = null;
    now = message;
    heard = performance.now();
    rallyscope.rallyRuns = message.live && message.playing;
    const appears = bar.hidden && message.visible;
    bar.hidden = !message.visible;
    document.body.classList.toggle("rallyscope-with-bar", message.visible);
    const play = button("play");
    const shape = message.playing ? "pause" : "play";
    if (play.dataset.shape !== shape) { play.dataset.shape = shape; play.innerHTML = ICONS[shape]; }
    play.setAttribute("aria-label", message.playing ? "Pause" : "Play");
    button("loop").hidden = !message.loop;
    button("end").classList.toggle("live", message.live && message.following);
    button("end").title = message.live ? "Back to what happens now (End)" : "To the end (End)";
    fill(find("#rallyscope-speed"), message.speeds, String(message.speed));
    fill(find("#rallyscope-step"), message.steps, String(message.step));
    if (first) watchPlace();
    place();
    if (appears) fitLegend(); // what is hidden has no size
    showTime();
    if (message.playing && !turning && !rallyscope.bySoftware) { turning = true; turn(); }
  };

  rallyscope.handlers.tracks = (message) => {
    tracks = message;
    view = null;
    showLegend();
    if (now) draw();
  };

  const watchPlace = () => {
    const pictures = document.querySelector("#root canvas");
    if (!pictures) return void setTimeout(watchPlace, 200);
    new ResizeObserver(place).observe(pictures);
    new ResizeObserver(place).observe(canvas);
    addEventListener("resize", place);
    place();
  };

  // Hands -----------------------------------------------------------------------------------------------------

  const happenings = () => [...now.marks, ...Object.values(tracks.moments).flat(), ...tracks.contacts.map(([t]) => t),
    ...(tracks.runs.detector || []).filter(([, , kind]) => kind !== "found").map(([start]) => start)].sort((a, b) => a - b);

  const act = (what) => {
    if (!now) return;
    const t = Math.round(position());
    if (what === "start") ask("seek", now.live ? now.start : 0);
    else if (what === "end") { ask("seek", now.end + 1e9); if (now.live && !now.playing) ask("play"); }
    else if (what === "back") ask("step", -1);
    else if (what === "back10") ask("step", -10);
    else if (what === "on") ask("step", 1);
    else if (what === "on10") ask("step", 10);
    else if (what === "play") ask("play");
    else if (what === "mark") ask("mark", t);
    else if (what === "loop") ask("loop", null);
    else if (what === "next") { const to = happenings().find((one) => one > t + 1); if (to !== undefined) ask("seek", to); }
    else if (what === "previous") { const to = happenings().filter((one) => one < t - 1).pop(); if (to !== undefined) ask("seek", to); }
    else if (what === "faster" || what === "slower") ask(what);
    else if (what === "pause") ask("play");
  };

  bar.addEventListener("click", (event) => {
    const pressed = event.target.closest("[data-do]");
    if (pressed) act(pressed.dataset.do);
  });
  addEventListener("click", (event) => { // a time in a list
    const time = event.target.closest?.("[data-rallyscope-seek]");
    if (time && now) ask("seek", Number(time.dataset.rallyscopeSeek));
  });
  rallyscope.ownField(time, (text) => {
    const t = timeOf(text), [first, last] = now.live ? [now.start, now.end] : [0, now.end];
    if (Number.isNaN(t)) throw new Error(`"${text}" is no time. Expected h:mm:ss.mmm, seconds as 1.25, or whole microseconds. The cursor stays.`);
    if (t < first || t > last) throw new Error(`${clock(t)} is outside this recording: it goes from ${clock(first)} to ${clock(last)}. The cursor stays.`);
    ask("seek", t);
  });
  time.addEventListener("blur", () => { if (now) showTime(); });
  find("#rallyscope-speed").addEventListener("change", (event) => ask("speed", Number(event.target.value)));
  find("#rallyscope-step").addEventListener("change", (event) => ask("step_us", Number(event.target.value)));

  let sent = 0;
  canvas.addEventListener("pointerdown", (event) => {
    if (!now || event.button) return;
    canvas.setPointerCapture(event.pointerId);
    const t = toTime(event.offsetX);
    drag = { loop: event.shiftKey, from: t, to: t };
    if (!drag.loop) ask("seek", t);
    draw();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!now) return;
    hover = event.offsetX;
    if (drag) {
      drag.to = Math.max(range()[0], Math.min(toTime(event.offsetX), range()[1]));
      if (!drag.loop && performance.now() - sent > 33) { sent = performance.now(); ask("seek", drag.to); }
    }
    showTip(event);
    draw();
  });
  canvas.addEventListener("pointerup", (event) => {
    if (!drag) return;
    if (drag.loop) ask("loop", drag.from === drag.to ? null : [drag.from, drag.to].sort((a, b) => a - b));
    else ask("seek", toTime(event.offsetX));
    drag = null;
  });
  canvas.addEventListener("pointercancel", () => { drag = null; draw(); });
  canvas.addEventListener("pointerleave", () => { hover = null; tip.hidden = true; draw(); });
  canvas.addEventListener("wheel", (event) => { // a closer look at the time line
    if (!now || now.live) return;
    event.preventDefault();
    const [a, b] = range(), t = toTime(event.offsetX), factor = event.deltaY > 0 ? 1.3 : 1 / 1.3;
    const length = Math.max(1000, (b - a) * factor);
    if (length >= now.end) view = null;
    else { const start = Math.min(Math.max(0, t - ((t - a) / (b - a)) * length), now.end - length); view = [start, start + length]; }
    draw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { view = null; draw(); });

  const showTip = (event) => {
    const t = toTime(event.offsetX), near = ((range()[1] - range()[0]) / canvas.clientWidth) * 5;
    const said = [];
    for (const [kind, times] of [...Object.entries(tracks.moments), ["mark", now.marks]])
      if (times.some((one) => Math.abs(one - t) < near)) said.push(words(kind));
    for (const [time, sigma, kind, proposed] of tracks.contacts)
      if (Math.abs(time - t) < near) said.push(`${proposed ? "proposed" : "labelled"} ${kind}${sigma ? ` ±${(sigma / 1000).toFixed(2)} ms` : ""}`);
    for (const [line, runs] of Object.entries(tracks.runs)) {
      const run = runs.find(([start, end]) => start - near / 5 <= t && t < end + near / 5);
      if (run) said.push(`${line}: ${words(run[2])}`);
    }
    for (const [name, rate] of Object.entries(tracks.rates)) {
      const value = rate[Math.floor((t / tracks.duration) * rate.length)];
      if (value !== undefined) said.push(`${name} ${((value / 255) * tracks.top_hz / 1e6).toFixed(2)} Mev/s`);
    }
    tip.textContent = [clock(t), micros(t), ...said].join(" · ");
    tip.hidden = false;
    tip.style.left = `${Math.min(event.offsetX + 12, canvas.clientWidth - tip.offsetWidth)}px`;
  };

  const KEYS = {
    j: "slower", k: "pause", l: "faster", ArrowLeft: "back", ArrowRight: "on", Home: "start", End: "end",
    "[": "previous", "]": "next", "'": "mark",
  };
  const inText = (event) =>
    event.target.closest("input:not([type=checkbox]), textarea, select, [contenteditable]") || document.querySelector("dialog[open]");
  addEventListener("keydown", (event) => {
    const digit = /^Digit([1-5])$/.exec(event.code);
    if (!digit || !event.shiftKey || event.ctrlKey || event.metaKey || event.altKey || inText(event)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    rallyscope.send("bar", { do: "mode", value: Number(digit[1]) });
  }, true);
  addEventListener("keydown", (event) => {
    if (!now || bar.hidden || !now.keys || event.ctrlKey || event.metaKey || event.altKey) return;
    if (inText(event) || event.target.closest("[role=slider]:not(#rallyscope-line), [role=combobox]")) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const what = KEYS[key];
    if (!what) return;
    event.preventDefault();
    event.stopImmediatePropagation(); // the arrows would move viser's camera, too
    act(event.shiftKey && what === "back" ? "back10" : event.shiftKey && what === "on" ? "on10" : what);
  }, true);

  addEventListener("DOMContentLoaded", () => document.body.append(bar));
  const tellSize = () => rallyscope.send("size", { width: innerWidth, height: innerHeight });
  addEventListener("resize", tellSize);
  const found = rallyscope.onFound;
  rallyscope.onFound = () => { found(); tellSize(); };
}
