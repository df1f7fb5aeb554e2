// Who this page is: told to the server in the address of viser's own websocket, so that a reload finds everything again.
rallyscope.page = crypto.getRandomValues(new Uint32Array(4)).reduce((text, one) => text + one.toString(16).padStart(8, "0"), "");
rallyscope.link = location.hash.slice(1);
if (location.hash) history.replaceState(null, "", location.pathname + location.search); // viser takes its server from it

rallyscope.socketUrl = (path, values) =>
  location.origin.replace(/^http/, "ws") + path + "?" + new URLSearchParams(values);

{
  const postMessage = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...more) {
    if (message && message.type === "set_server" && !message.server.includes("?")) {
      const link = rallyscope.link.length < 4000 ? rallyscope.link : "";
      message = { ...message, server: rallyscope.socketUrl("/", { page: rallyscope.page, link }) };
    }
    return postMessage.call(this, message, ...more);
  };
}
