// A second websocket beside viser's: small messages between this page and its session.
rallyscope.handlers = {}; // by type: what to do with a message of the server
rallyscope.onLost = () => {};
rallyscope.onFound = () => {};

rallyscope.send = (type, values = {}) => {
  const socket = rallyscope.socket;
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type, ...values }));
};

rallyscope.connect = () => {
  const socket = new WebSocket(rallyscope.socketUrl("/rallyscope/page", { page: rallyscope.page }));
  rallyscope.socket = socket;
  socket.onopen = () => rallyscope.onFound();
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    const handler = rallyscope.handlers[message.type];
    if (handler) handler(message);
  };
  socket.onclose = (event) => rallyscope.onLost(event.code);
};

addEventListener("DOMContentLoaded", rallyscope.connect);
