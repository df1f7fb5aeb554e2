// viser reconnects only while the page has the focus. This looks for the server from a worker, whose clock runs on in
// pages that nobody looks at, and loads the page again as soon as it answers: the address and the server know the rest.
{
  const clock = `setInterval(() => postMessage(0), 700);`;
  let ticker = null;
  let banner = null;

  const showBanner = (text) => {
    if (!banner) {
      banner = document.createElement("div");
      banner.id = "rallyscope-banner";
      banner.setAttribute("role", "alert");
      document.body.append(banner);
    }
    banner.textContent = text;
  };

  const look = async () => {
    try {
      const answer = await fetch("/rallyscope/alive", { cache: "no-store", signal: AbortSignal.timeout(2000) });
      if (answer.status === 200) location.reload();
      else if (answer.status === 401) showBanner("The server is back, but wants its token: open the link that it printed.");
    } catch {
      // not there yet
    }
  };

  let leaving = false;
  addEventListener("beforeunload", () => (leaving = true));
  rallyscope.onLost = () => {
    if (leaving || ticker) return;
    showBanner("Server gone, reconnecting …");
    ticker = new Worker(URL.createObjectURL(new Blob([clock], { type: "text/javascript" })));
    ticker.onmessage = look;
  };
}
