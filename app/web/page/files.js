// Open file: a dialog with what the server offers, files that are dropped onto the page, and how far opening is.
{
  const MOST_BYTES = 200e6, SHOWN_S = 45;
  const dialog = document.createElement("dialog");
  dialog.id = "rallyscope-files";
  dialog.setAttribute("aria-labelledby", "rallyscope-files-title");
  dialog.innerHTML = `
    <h2 id="rallyscope-files-title">Open file</h2>
    <p>Drop one anywhere on this page (up to 200 MB), or <button type="button" data-do="choose">Choose a file ...</button>
      <input type="file" aria-label="File of this computer" tabindex="-1" hidden></p>
    <input type="search" aria-label="Search the files" placeholder="Search" autocomplete="off" hidden>
    <ul aria-label="Files of the server"></ul>
    <div class="question" hidden>
      <p></p><div class="facts"></div>
      <fieldset>
        <legend>What the file does not say (empty: as above)</legend>
        <label>Width <input data-field="width" inputmode="numeric" maxlength="7" placeholder="px" autocomplete="off"></label>
        <label>Height <input data-field="height" inputmode="numeric" maxlength="7" placeholder="px" autocomplete="off"></label>
        <label>Time unit <select data-field="time_unit"><option value=""></option><option>ns</option><option>us</option><option>ms</option><option>s</option></select></label>
        <label>Polarity <input data-field="polarity" class="wide" maxlength="200" placeholder="1=on,2=off" autocomplete="off"></label>
      </fieldset>
      <div class="end"><button type="button" data-do="cancel">Cancel</button><button type="button" data-do="import" class="main">Import</button></div>
    </div>
    <p class="more"></p>
    <p class="samples"></p>
    <div class="busy" role="status" hidden>
      <span></span><progress max="1" aria-label="Progress"></progress><button type="button" data-do="cancel">Cancel</button>
    </div>
    <p class="problem" role="alert"></p>
    <div class="end"><button type="button" data-do="close">Close</button></div>`;
  const card = document.createElement("section");
  card.id = "rallyscope-opened";
  card.hidden = true;
  card.setAttribute("role", "status");
  const veil = document.createElement("div");
  veil.id = "rallyscope-drop";
  veil.hidden = true;
  veil.textContent = "Drop the file to open it";
  const find = (selector) => dialog.querySelector(selector);
  const list = find("ul"), search = find("[type=search]"), chosen = find("[type=file]"), busy = find(".busy"), question = find(".question");
  const fields = [...dialog.querySelectorAll("[data-field]")], main = find(".question .main");
  const element = (name, text) => { const made = document.createElement(name); made.textContent = text; return made; };

  let files = [], leftOut = 0, upload = null, importing = false, seen = 0, asked = 0, answered = {}, refused = false, asking = "";

  const open = () => {
    if (!dialog.open) { say(""); dialog.showModal(); }
    if (!files.length) find(".more").textContent = "Looking for files ...";
    rallyscope.send("files", { do: "list" });
  };
  const say = (problem) => { find(".problem").textContent = problem; };
  const work = (text, share) => {
    busy.hidden = text === null;
    list.inert = search.inert = find("[data-do=choose]").disabled = text !== null;
    if (text === null) return;
    busy.querySelector("span").textContent = text;
    busy.querySelector("progress").value = share;
    if (!dialog.open) open();
  };

  // The list ------------------------------------------------------------------------------------------------------

  const showList = () => {
    const wanted = search.value.trim().toLowerCase();
    const fitting = files.filter(([, name, folder, kind]) => `${name} ${folder} ${kind}`.toLowerCase().includes(wanted));
    search.hidden = files.length <= 8;
    list.replaceChildren(...fitting.map(([key, name, folder, kind, size]) => {
      const row = document.createElement("li"), button = document.createElement("button");
      button.type = "button";
      button.dataset.key = key;
      button.append(element("b", name), element("span", kind), element("span", size), element("i", folder));
      row.append(button);
      return row;
    }));
    find(".more").textContent = !files.length ? "There are no event files or recordings in the server's folders."
      : !fitting.length ? "None is called so." : leftOut ? `${leftOut} more are not listed.` : "";
  };
  rallyscope.handlers.files = (message) => { files = message.files; leftOut = message.left_out; find(".samples").textContent = message.samples; showList(); };
  search.addEventListener("input", showList);
  list.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const buttons = [...list.querySelectorAll("button")];
    const next = buttons[buttons.indexOf(document.activeElement) + step];
    if (next) next.focus();
  });

  // What the server says of an opening ------------------------------------------------------------------------------

  rallyscope.handlers.opening = (message) => {
    importing = message.state === "importing";
    ask(message);
    if (importing) {
      if (message.number !== seen) say("");
      const number = (seen = message.number), text = `Opening ${message.file} ...`;
      if (dialog.open) work(text, message.share);
      else setTimeout(() => { if (importing && seen === number) work(text, message.share); }, 300); // what is quick needs no dialog
    } else work(null);
    if (message.problem) { open(); say(message.file && message.state === "failed" ? `${message.file}: ${message.problem}` : message.problem); }
    if (message.state === "done") { dialog.close(); showFacts(message); }
    if (message.state === "left") card.hidden = true; // they would stand over the figures of another recording
  };
  rallyscope.handlers.files_dialog = (message) => { if (message.number > asked) { asked = message.number; open(); } };

  const showFacts = (message) => {
    const facts = document.createElement("ul"), close = element("button", "×");
    facts.append(...message.facts.map((fact) => element("li", fact)), ...message.notes.map((note) => element("li", note)));
    close.setAttribute("aria-label", "Close");
    close.onclick = () => { card.hidden = true; };
    card.replaceChildren(close, element("b", message.file), element("p", message.kind), facts);
    card.hidden = false;
    clearTimeout(card.timer);
    card.timer = setTimeout(() => { if (!card.matches(":hover, :focus-within")) card.hidden = true; }, SHOWN_S * 1000);
  };

  // What stands in a file that assumes something, before it is imported -----------------------------------------------

  const ask = (message) => {
    const asks = message.state === "question";
    if (asks && !question.hidden) return; // what stands in the fields is the person's
    question.hidden = !asks;
    dialog.classList.toggle("asks", asks);
    if (!asks) return;
    if (!dialog.open) open();
    const facts = question.querySelector(".facts");
    question.querySelector("p").textContent = (message.refused ? `${message.file} cannot be imported as it is.`
      : `${message.file}: please look at this before it is imported.`) + (message.complete ? "" : " It is large: only its first part was read.");
    facts.replaceChildren(...message.cameras.map(({ name, rows }) => {
      const table = document.createElement("table");
      if (message.cameras.length > 1) table.append(element("caption", `Camera ${name}`));
      table.append(...rows.map(([label, value]) => {
        const row = document.createElement("tr"), head = element("th", label);
        head.scope = "row";
        row.append(head, element("td", value));
        return row;
      }));
      return table;
    }));
    for (const [title, lines] of [["Assumed", message.assumed], ["Notes", message.notes]]) {
      if (!lines.length) continue;
      const found = document.createElement("ul");
      found.setAttribute("aria-label", title);
      found.append(...lines.map((line) => element("li", line)));
      facts.append(element("h3", title), found);
    }
    answered = message.fields;
    asking = message.file;
    refused = message.refused;
    for (const field of fields) field.value = answered[field.dataset.field] || "";
    offer();
    (refused ? fields[0] : main).focus();
  };
  const written = () => Object.fromEntries(fields.map((field) => [field.dataset.field, field.value.trim()]));
  const offer = () => { // what is filled in is looked at before it is imported
    const anew = refused || Object.entries(written()).some(([name, value]) => value !== (answered[name] || ""));
    main.dataset.do = anew ? "check" : "import";
    main.textContent = anew ? "Check" : "Import";
  };

  // Sending a file --------------------------------------------------------------------------------------------------

  const send = (file) => {
    say("");
    if (!question.hidden) return say(`${asking} waits for your answer: import or cancel it first. ${file.name} was not opened.`);
    if (upload || importing) return say("A file is being opened already; wait for it, or cancel it.");
    if (file.size > MOST_BYTES)
      return say(`${file.name} has ${Math.ceil(file.size / 1e6)} MB, and up to 200 MB can be sent. Put it into the server's folder of recordings instead.`);
    const mine = (upload = rallyscope.upload(file, "recording", {
      onProgress: (share) => { if (upload === mine) work(share < 1 ? `Sending ${file.name} ...` : `Opening ${file.name} ...`, share < 1 ? share : 0); },
      onRefused: (why) => { if (upload === mine) { upload = null; work(null); say(`${file.name}: ${why}`); } },
      onSent: () => { if (upload === mine) upload = null; },
    }));
    work(`Sending ${file.name} ...`, 0);
  };
  const cancel = () => {
    if (upload) { upload.cancel(); upload = null; }
    rallyscope.send("files", { do: "cancel" });
    work(null);
  };

  // A person's hand --------------------------------------------------------------------------------------------------

  dialog.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    if (button.dataset.key) { say(""); rallyscope.send("files", { do: "open", key: button.dataset.key }); }
    else if (button.dataset.do === "choose") chosen.click();
    else if (button.dataset.do === "import") rallyscope.send("files", { do: "import", number: seen });
    else if (button.dataset.do === "check") { say(""); rallyscope.send("files", { do: "check", number: seen, fields: written() }); }
    else if (button.dataset.do === "cancel") cancel();
    else if (button.dataset.do === "close") dialog.close();
  });
  chosen.addEventListener("change", () => { if (chosen.files.length) send(chosen.files[0]); chosen.value = ""; });
  for (const field of fields) {
    field.addEventListener("input", offer);
    field.addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); main.click(); } });
  }
  dialog.addEventListener("close", () => { if (!question.hidden) cancel(); });
  dialog.addEventListener("keydown", (event) => event.stopPropagation()); // keys of the app mean nothing here
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.shiftKey || event.altKey || event.key.toLowerCase() !== "o") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    open();
  }, true);

  const carriesFiles = (event) => event.dataTransfer && [...event.dataTransfer.types].includes("Files");
  let inside = 0; // elements of the page that the dragged file has entered and not left
  const drag = (kind, act) => addEventListener(kind, (event) => {
    if (!carriesFiles(event)) return;
    event.preventDefault();
    event.stopPropagation();
    act(event);
    veil.hidden = inside <= 0;
  }, true);
  drag("dragenter", () => { inside += 1; });
  drag("dragover", (event) => { event.dataTransfer.dropEffect = "copy"; inside = Math.max(inside, 1); });
  drag("dragleave", () => { inside = Math.max(0, inside - 1); });
  drag("drop", (event) => {
    inside = 0;
    const [file, ...others] = event.dataTransfer.files;
    open();
    if (others.length) say("One file at a time, please.");
    else if (file) send(file);
  });

  addEventListener("DOMContentLoaded", () => document.body.append(dialog, card, veil));
}
