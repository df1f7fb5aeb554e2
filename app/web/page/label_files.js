// A file of labels of this computer for Label's panel: a dialog that sends it and says what became of it.
{
  const MOST_BYTES = 50e6;
  const dialog = document.createElement("dialog");
  dialog.id = "rallyscope-label-files";
  dialog.setAttribute("aria-labelledby", "rallyscope-label-files-title");
  dialog.innerHTML = `
    <h2 id="rallyscope-label-files-title">Upload labels</h2>
    <p>One file of labels (CSV, JSON, XML, TXT ...), a ZIP of many, or a label store (.sqlite), up to 50 MB.
      Nothing is stored as a label before you accept it.</p>
    <p><button type="button" data-do="choose">Choose a file ...</button>
      <input type="file" aria-label="File of labels of this computer" tabindex="-1" hidden></p>
    <div class="busy" role="status" hidden>
      <span></span><progress max="1" aria-label="Progress"></progress><button type="button" data-do="cancel">Cancel</button>
    </div>
    <p class="problem" role="alert"></p>
    <div class="end"><button type="button" data-do="close">Close</button></div>`;
  const find = (selector) => dialog.querySelector(selector);
  const chosen = find("[type=file]"), busy = find(".busy"), choose = find("[data-do=choose]");
  let upload = null, asked = 0, answered = 0;

  const say = (problem) => { find(".problem").textContent = problem; };
  const work = (text, share = 0) => {
    busy.hidden = text === null;
    choose.disabled = text !== null;
    if (text === null) return;
    busy.querySelector("span").textContent = text;
    busy.querySelector("progress").value = share;
  };
  const send = (file) => {
    say("");
    if (file.size > MOST_BYTES) return say(`${file.name} has ${Math.ceil(file.size / 1e6)} MB, and up to 50 MB can be sent.`);
    work(`Sending ${file.name} ...`);
    const mine = (upload = rallyscope.upload(file, "labels", {
      onProgress: (share) => { if (upload === mine) work(share < 1 ? `Sending ${file.name} ...` : `Unpacking ${file.name} ...`, share); },
      onRefused: (why) => { if (upload === mine) { upload = null; work(null); say(`${file.name}: ${why}`); } },
      onSent: () => { if (upload === mine) upload = null; },
    }));
  };
  const cancel = () => {
    if (upload) upload.cancel();
    upload = null;
    work(null);
  };

  rallyscope.handlers.label_files_dialog = ({ number }) => {
    if (number <= asked) return;
    asked = number;
    say("");
    if (!dialog.open) dialog.showModal();
  };
  rallyscope.handlers.label_file = ({ number, problem }) => {
    if (number <= answered) return;
    answered = number;
    work(null);
    if (problem) say(problem);
    else dialog.close();
  };
  dialog.addEventListener("click", (event) => {
    const what = event.target.closest("button")?.dataset.do;
    if (what === "choose") chosen.click();
    else if (what === "cancel") cancel();
    else if (what === "close") dialog.close();
  });
  chosen.addEventListener("change", () => { if (chosen.files.length) send(chosen.files[0]); chosen.value = ""; });
  dialog.addEventListener("close", cancel);
  dialog.addEventListener("keydown", (event) => event.stopPropagation()); // keys of the app mean nothing here
  addEventListener("DOMContentLoaded", () => document.body.append(dialog));
}
