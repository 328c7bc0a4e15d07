// NiceGUI has built the page, and its own socket carries nothing here. Left open, it would load the page anew once the
// dashboard had been restarted: perhaps while the operator keeps a button pressed, and without what has been seen so far.
export function detach() {
  window.socket?.io.reconnection(false);
  window.socket?.disconnect();
}
