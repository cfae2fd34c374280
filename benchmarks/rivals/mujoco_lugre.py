"""MuJoCo (4.0 or newer), whose dcmotor actuator has LuGre friction."""

from collections.abc import Callable

import mujoco
import numpy as np
from mujoco import rollout


def model(parameters, dt: float) -> "mujoco.MjModel":
    """A slider with the friction of `parameters` (J, sigma0, sigma1, sigma2, Fc, Fs, vs), driven by a force."""
    J, s0, s1, s2, Fc, Fs, vs = (float(p) for p in parameters)
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{dt!r}" integrator="Euler" gravity="0 0 0"/>
  <worldbody><body><joint name="slide" type="slide" axis="1 0 0" damping="{s2!r}"/>
    <geom size="0.1" mass="{J!r}"/></body></worldbody>
  <actuator>
    <motor joint="slide"/>
    <dcmotor joint="slide" input="none" motorconst="0" resistance="1" lugre="{s0!r} {s1!r} {Fc!r} {Fs!r} {vs!r}"/>
  </actuator>
</mujoco>""")


def runner(parameters: np.ndarray, force: np.ndarray, dt: float, threads: int) -> Callable[[], np.ndarray]:
    """A function that rolls all drives out on `threads` threads and returns positions (b, n); `parameters` (b, 7)."""
    models = [model(row, dt) for row in parameters]
    data = [mujoco.MjData(models[0]) for _ in range(threads)]
    first = np.zeros((len(models), mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    push = np.ascontiguousarray(np.broadcast_to(force[None, :, None], (len(models), force.size, 1)))

    def run() -> np.ndarray:
        state, _ = rollout.rollout(models, data, first, push)
        return np.concatenate([np.zeros((len(models), 1)), np.asarray(state)[:, :-1, 1]], axis=1)

    return run
