"""Draw the site's pictures: all, or those that are named. `make docs-pictures`; two minutes, most of it simulation."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import results
import runs
import schematics
from style import save

PICTURES = {
    function.__name__.removeprefix("draw_"): function
    for function in (
        schematics.draw_lift, schematics.draw_tilt, schematics.draw_planes, schematics.draw_frames,
        results.draw_methods, results.draw_balance,
        runs.draw_result, runs.draw_bisection, runs.draw_tipping, runs.draw_excitation, runs.draw_sensors, runs.draw_plan,
        runs.draw_payload,
    )
}  # fmt: skip

if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        print(save(PICTURES[name](), name))
