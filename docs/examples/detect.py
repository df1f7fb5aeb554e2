"""Opens a recording and finds the ball in every window of 2 ms: `python docs/examples/detect.py [RECORDING]`."""

from small_input import recording_path

from core.detection import make_detector
from core.metrics import run_detector
from core.recordings import open_recording

with open_recording(recording_path()) as recording:
    for name, camera in recording.cameras.items():
        answers = run_detector(camera, make_detector("auto", camera.sensor), window_us=2000)
        print(f"{name}: {camera.event_count} events, {answers.detected.sum()} balls in {len(answers.t_us)} windows")
        for row in answers.detected.nonzero()[0][:3]:
            print(f"  {answers.t_us[row]} us: x {answers.u_px[row]:.1f} px, y {answers.v_px[row]:.1f} px")
