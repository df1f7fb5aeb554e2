// One rule for every field that takes text. Enter takes what stands in it and Escape puts back what stood there before; both
// give the keyboard back to the page. Leaving a field takes what stands in it, too. What a field cannot hold is refused with a
// line beside it, and the field shows again what holds.
//
// viser sends a value at every letter, at most one every 50 ms, and of two controls that change within them only the last. So
// while a field is typed in none of its values goes out: when it is left, the whole value is read from the page and sent before
// anything else that the page sends.
{
  const LINE_MS = 8000, LATE_MS = 200;
  const own = new Map(); // fields of ours: element -> takes its text, or throws an error with the line that is shown
  const leaving = new Map(); // viser's fields that were left and not sent yet: uuid -> what was typed
  const quiet = new Map(); // viser's fields that were put back: uuid -> timer; what viser sends of them is late
  let typing = null; // { field, uuid, before }: the field that is typed in
  let worker = null, writing = false;

  const line = document.createElement("div");
  line.id = "rallyscope-message";
  line.setAttribute("role", "status");
  line.hidden = true;
  let hides = null;
  rallyscope.showLine = (text, near = null) => {
    line.textContent = text;
    line.hidden = false;
    const box = near?.isConnected ? near.getBoundingClientRect() : null, width = line.offsetWidth, height = line.offsetHeight;
    const left = box ? box.left : (innerWidth - width) / 2, below = box ? box.bottom + 4 : innerHeight - height - 100;
    line.style.left = `${Math.max(8, Math.min(left, innerWidth - width - 8))}px`;
    line.style.top = `${below + height + 8 > innerHeight && box ? box.top - height - 4 : below}px`;
    clearTimeout(hides);
    hides = setTimeout(() => { line.hidden = true; }, LINE_MS);
  };

  let number = 0; // of the latest line of the server: a page that connects anew is sent it again
  rallyscope.handlers.line = (message) => {
    if (message.number > number) { number = message.number; rallyscope.showLine(message.text); }
  };

  const isText = (one) => one instanceof HTMLInputElement && !/^(checkbox|radio|hidden|file|button|range|color)$/.test(one.type)
    && !one.readOnly && !one.matches("[aria-haspopup=listbox], [role=combobox]") && !one.closest("dialog, [class*=Spotlight]");
  const isNumber = (field) => field.matches("[class*=mantine-NumberInput]");
  const rowOf = (field) => {
    let row = field.parentElement;
    for (let up = 0; row && up < 8; up += 1, row = row.parentElement) {
      const labels = row.querySelectorAll("label[for]");
      if (labels.length) return labels.length === 1 ? row : null;
    }
    return null;
  };
  const uuidOf = (field) => rowOf(field)?.querySelector("label[for]").htmlFor ?? null;
  const nameOf = (field) => rowOf(field)?.querySelector("label[for]").textContent.trim() || field.getAttribute("aria-label") || "This field";

  const write = (field, text) => { // as if it were typed: viser's page keeps a copy of its own
    writing = true;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, text);
    field.dispatchEvent(new Event("input", { bubbles: true }));
    writing = false;
  };

  const keepAway = (field) => { // the library of viser's number boxes focuses them again to place the caret, after they were left
    field.focus = () => {};
    setTimeout(() => { delete field.focus; }, LATE_MS);
  };

  const putBack = ({ field, uuid, before }) => {
    if (uuid) {
      clearTimeout(quiet.get(uuid));
      quiet.set(uuid, setTimeout(() => quiet.delete(uuid), LATE_MS));
    }
    if (isNumber(field)) keepAway(field);
    write(field, before);
  };

  // What a field of viser's holds once it was left: a box has brought a number inside its bounds by then. undefined: none.
  const valueOf = (field) => {
    if (!isNumber(field)) return field.value;
    const boxes = [...rowOf(field).querySelectorAll("input")].filter((one) => isText(one) && isNumber(one));
    const numbers = boxes.map((box) => (box.value.trim() ? Number(box.value) : NaN));
    // An empty box beside it stays so: a centre is typed one box after the other.
    const isWhole = boxes.every((box, at) => Number.isFinite(numbers[at]) || (box !== field && !box.value.trim()));
    return !isWhole ? undefined : numbers.length > 1 ? numbers : numbers[0];
  };

  const send = (uuid, left) => {
    const { field, typed, before } = left;
    if (!field.isConnected) return;
    if (!isNumber(field) && field.value === before) rallyscope.send("field", { name: nameOf(field), text: before }); // viser passes on what changed only
    const value = valueOf(field);
    if (value === undefined) {
      rallyscope.showLine(`${nameOf(field)}: a number is expected, not "${typed}"; it stays ${before}.`, field);
      return putBack(left);
    }
    if (isNumber(field) && Number(typed) !== Number(field.value))
      rallyscope.showLine(`${nameOf(field)}: ${typed} does not fit, ${field.value} is taken.`, field);
    post.call(worker, { type: "send", message: { type: "GuiUpdateMessage", uuid, updates: { value } } });
  };

  const sendAll = () => {
    for (const [uuid, left] of [...leaving]) {
      leaving.delete(uuid);
      send(uuid, left);
    }
  };

  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...more) {
    if (message?.type === "send") {
      worker = this;
      const { type, uuid } = message.message;
      if (type === "GuiUpdateMessage" && (typing?.uuid === uuid || leaving.has(uuid) || quiet.has(uuid))) return;
      if (type !== "ViewerCameraMessage") sendAll();
    }
    return post.call(this, message, ...more);
  };

  const take = () => { // what stands in the field that is typed in
    if (!typing) return;
    const left = { ...typing, typed: typing.field.value };
    typing = null;
    if (own.has(left.field)) {
      try {
        own.get(left.field)(left.typed);
      } catch (error) {
        rallyscope.showLine(error.message, left.field);
        left.field.value = left.before;
      }
    } else if (left.uuid && worker) {
      leaving.set(left.uuid, left);
      setTimeout(sendAll);
    }
  };

  const giveBack = () => { // the field shows again what it showed before it was typed in
    if (!typing) return;
    const left = typing;
    typing = null;
    if (own.has(left.field)) left.field.value = left.before;
    else putBack(left);
  };

  rallyscope.ownField = (field, takes) => own.set(field, takes);

  const held = new WeakMap(); // field -> what it held when it was last not typed in
  addEventListener("focusin", ({ target }) => { if (isText(target)) held.set(target, target.value); }, true);
  addEventListener("beforeinput", ({ target }) => { if (isText(target) && typing?.field !== target) held.set(target, target.value); }, true);
  addEventListener("input", ({ target }) => {
    if (writing || !isText(target) || typing?.field === target) return;
    take(); // of another field: it was not left by a person
    const uuid = own.has(target) ? null : uuidOf(target);
    if (uuid || own.has(target)) typing = { field: target, uuid, before: held.get(target) ?? "" };
  }, true);
  addEventListener("focusout", ({ target }) => {
    if (typing?.field === target) take();
    if (isText(target) && isNumber(target)) keepAway(target);
  }, true);

  addEventListener("click", ({ target }) => { // of a button that takes no focus, as in Safari
    if (target instanceof Element && target.closest("button")) take();
  }, true);

  addEventListener("keydown", (event) => {
    const field = event.target;
    if ((event.key !== "Enter" && event.key !== "Escape") || event.isComposing || !isText(field)) return;
    const isWindow = field.closest("[class*=mantine-Modal-content]"); // its keys press its buttons, and it keeps the keyboard
    if (isWindow) {
      if (event.key === "Enter") { take(); if (!isNumber(field)) sendAll(); }
      return;
    }
    event.preventDefault();
    event.stopImmediatePropagation();
    const { form } = field;
    if (event.key === "Enter") take(); else giveBack();
    field.blur(); // at once: the next key may come before any timer
    if (event.key === "Enter" && form) form.requestSubmit();
  }, true);

  // A list that the mouse chose in leaves the keyboard to the page, too.
  let pressed = null;
  addEventListener("pointerdown", ({ target }) => { pressed = target; }, true);
  addEventListener("change", ({ target }) => { if (target instanceof HTMLSelectElement && pressed === target) target.blur(); });
  addEventListener("keydown", (event) => {
    if (event.target instanceof HTMLSelectElement && (event.key === "Enter" || event.key === "Escape")) event.target.blur();
    else if (event.key === "Tab") pressed = null;
  }, true);

  addEventListener("DOMContentLoaded", () => document.body.append(line));
}
