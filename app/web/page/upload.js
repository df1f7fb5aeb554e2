// Sends a file of this computer to the server, in pieces that are acknowledged; the purpose says who takes it there.
{
  const PIECE_BYTES = 1 << 18, AHEAD = 4;
  rallyscope.upload = (file, purpose, { onProgress, onRefused, onSent }) => {
    const socket = new WebSocket(rallyscope.socketUrl("/rallyscope/upload", { page: rallyscope.page }));
    let got = 0, sent = 0, reading = false, over = false;
    const end = (refused) => {
      if (over) return;
      over = true;
      socket.close();
      if (refused) onRefused(refused);
      else onSent();
    };
    const more = async () => {
      if (reading) return;
      reading = true;
      try {
        while (sent < file.size && sent - got < AHEAD * PIECE_BYTES && socket.readyState === WebSocket.OPEN) {
          const piece = await file.slice(sent, sent + PIECE_BYTES).arrayBuffer();
          if (!piece.byteLength) throw new Error("empty");
          sent += piece.byteLength;
          socket.send(piece);
        }
      } catch {
        end("This browser could not read it; it may be a folder, or have changed meanwhile.");
      }
      reading = false;
    };
    socket.onopen = () => socket.send(JSON.stringify({ name: file.name, size: file.size, purpose }));
    socket.onmessage = (event) => {
      const said = JSON.parse(event.data);
      if (said.refused) return end(said.refused);
      if (said.got) got = said.got;
      if (!over) onProgress(got / file.size);
      more();
    };
    socket.onclose = () => end(got < file.size ? "The connection ended before it was sent." : "");
    return { cancel: () => { over = true; socket.close(); } };
  };
}
