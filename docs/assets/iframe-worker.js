// Search in pages opened from a disk, where browsers refuse Web Workers: the worker's script runs in a hidden frame.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.append(frame)
      const worker = frame.contentWindow
      const send = (target, data) => setTimeout(() => target.dispatchEvent(new MessageEvent("message", { data })))
      worker.postMessage = (data) => send(this, data)
      const script = frame.contentDocument.createElement("script")
      const loaded = new Promise((done) => script.addEventListener("load", done))
      script.src = url
      frame.contentDocument.body.append(script)
      this.postMessage = (data) => loaded.then(() => send(worker, data))
    }
  }
}
