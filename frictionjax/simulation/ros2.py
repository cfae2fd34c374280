"""One step of the fixed-step scheme: a two-stage Rosenbrock W-method, second order and L-stable.

    (I - g h A) k1 = f(y),   (I - g h A) k2 = f(y + h k1) - 2 k1,   y+ = y + 3/2 h k1 + 1/2 h k2,   g = 1 - 1/sqrt(2)

(Verwer, Spee, Blom, Hundsdorfer 1999). The order does not depend on A, so A contains only the stiff terms: the
bristles, their damping and the viscous force. A is an arrow matrix (bristles couple only through v) and is solved by
elimination, whatever the number of bristles; a second inertia behind a coupling is eliminated likewise. |v| is never
smoothed: that would make the bristles creep at rest. Forces that depend on the position (springs, ripple) are outside
A: they must be slow against the step, k h^2/J below 4.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.core.safe import sign
from frictionjax.physics import Bristles, Drive, Push, mean_of
from frictionjax.simulation.load_side import contact, relaxed

_GAMMA = 1.0 - 0.5**0.5
# Under forces m - d and m + d in the two stages a mass goes m h^2/(2 J) - d (1/2 - g) h^2/J; a line that rises by r
# takes it m h^2/(2 J) - r h^2/(12 J).
_APART = 1.0 / 12.0 / (0.5 - _GAMMA)
# A bristle never deflects beyond G/sigma0; an accurate step stays below this multiple of it.
LARGEST_YIELD = 2.5
# On a way as short as this the slope of the law is that at its beginning.
_NEAR = 1e-3
# h C + h^2 K of a coupling, over both masses: below this, a step without A would change the speed by less than itself.
_FOLLOWED = 1.0


Substeps = int | Int[Numbers, ""]
"""Number of integration steps a sample: of the program, or a number of the case, without a reverse-mode derivative."""


class DriveState(eqx.Module):
    """State of a drive: position `x`, velocity `v`, deflection of LuGre's `bristle` and of the elasto-slip `elements`
    beside it, shape `(n,)` (position units, s), and the states that effects add, `hidden`, of shape `(m,)`."""

    # Apart: the compiler finds no vector instructions for a loop in which one array is cut off another.
    x: Float[Array, "*d"]
    v: Float[Array, "*d"]
    bristle: Float[Array, "*d"]
    elements: Float[Array, "*d n"]
    hidden: Float[Array, "*d m"] = eqx.field(default_factory=lambda: jnp.zeros(0))

    @property
    def z(self) -> Float[Array, "*d bristles"]:
        """Deflection of every bristle element, LuGre's first, position units."""
        return jnp.concatenate([self.bristle[..., None], self.elements], axis=-1)


def ros2_step(
    drive: Drive,
    bristles: Bristles,
    state: DriveState,
    force: Float[Array, ""] | Push,
    h: Float[Array, ""],
    *,
    exact_derivative: bool = True,
) -> DriveState:
    """Advance `state` by `h` s under the motor force `force`, held over the step, or a `Push` that changes in it.

    Without `exact_derivative` the derivatives of A are left out of what is differentiated. As the order does not
    depend on A, derivatives stay correct to second order in `h`, at less than half the cost: for the Jacobians of fits.
    """
    friction = drive.friction
    # Each stage has its own force: with these two a mass reaches the same position as under the line.
    mean = early = late = mean_of(force)
    if isinstance(force, Push):
        early, late = mean - _APART * force.rise, mean + _APART * force.rise
    gh = _GAMMA * h
    side, own = drive.load_side, drive.state_count
    mobility = 1.0 / drive.J if side is None else 1.0 / (drive.J * (1.0 - side.ratio))
    share, slack = bristles.share[1:], bristles.slack[1:] / friction.sigma0
    alone = bristles.share.shape[-1] == 1
    first = bristles.share[0]

    def total(values):
        return jnp.sum(share * values)

    def opposing(spring, rate, beside, bent, damped, sigma1):
        """Equation (1): `spring` force and `rate` of LuGre's bristle; `bent` and `damped`, the sums over the others."""
        # Without other elements nothing is added: the compiler may not drop a product with zero.
        if alone:
            return spring + sigma1 * rate + beside
        return first * spring + friction.sigma0 * bent + sigma1 * (first * rate + damped) + beside

    def slips(bend, speed):
        """Slip velocity of LuGre's bristle over |speed|, and its derivative by `bend`."""
        if not drive.has_slip_effects:
            return bend, 1.0
        return jax.jvp(lambda bent: drive.slip(bent, speed), (bend,), (jnp.ones_like(bend),))

    x, v, z = state.x, state.v, state.bristle
    hidden, load = state.hidden[:own], state.hidden[own:]
    sigma1 = drive.sigma1(v)
    spring, slope = jax.jvp(drive.spring_force, (z,), (jnp.ones_like(z),))

    # The terms that depend on the velocity, with their derivatives: one evaluation gives f and its part of A. States of
    # effects relax by their own exact step, outside A. The velocity of the bristles is w, and LuGre's slips with s.
    def moving(speed):
        now = drive.instant(x, speed, mean, spring, state.hidden)
        speeds = drive.bristle_speed(now), drive.slip_speed(now)
        return (*speeds, drive.level_at(now), drive.parallel_force(now)), drive.relaxation(now)

    (w, s, level, beside), (w_v, s_v, level_v, beside_v), flow = jax.jvp(
        moving, (v,), (jnp.ones_like(v),), has_aux=True
    )
    softness = 1.0 / level
    bend = spring * softness
    lost, lost_b = slips(bend, s)
    rate = w - jnp.abs(s) * lost
    # An elasto-slip element moves with the machine until it yields: h times its mean rate is its change of deflection.
    limit = level * slack
    plays = bristles.cut(state.elements, limit)
    bent = moved = stuck = bent_1 = moved_1 = 0.0
    if not alone:
        bent, moved = total(plays), total(bristles.cut(plays + h * w, limit) - plays) / h
    friction_now = opposing(spring, rate, beside, bent, moved, sigma1)
    # Across a velocity reversal the bristle rate, which grows with |v|, may rise from zero to far beyond 1/h. A is then
    # evaluated at the speed ahead, if that is larger; elsewhere at the present speed, which keeps the step L-stable.
    # The level stays that of the present speed, and its slope is left out there.
    ahead = v + h * (mean - friction_now) * mobility
    turns = (ahead + v) * v < 0.0

    def faster(speed, slope):
        return jnp.where(turns, speed + slope * (ahead - v), speed)

    fast = faster(s, s_v)
    if drive.has_force_effects:
        # A viscous force that is stronger on the other side must enter A with that strength, or the step is unstable.
        def beyond(speed):
            return drive.parallel_force(drive.instant(x, speed, mean, spring, state.hidden))

        _, beyond_v = jax.jvp(beyond, (ahead,), (jnp.ones_like(v),))
        beside_v = jnp.where(turns, jnp.maximum(beside_v, beyond_v), beside_v)
    if drive.has_steep_slip:
        # A step may begin where the bristle hardly slips and reach where it slips: A then takes the mean slope of the
        # law on the way that a bristle without slip would go, up to steady sliding.
        steady = sign(fast)
        reached = steady * jnp.minimum(steady * (bend + h * faster(w, w_v) * slope * softness), 1.0)
        way = reached - bend
        near = jnp.abs(way) < _NEAR
        rise = (drive.slip(reached, fast) - lost) / jnp.where(near, 1.0, way)
        lost_b = jnp.maximum(lost_b, jnp.where(near, lost_b, rise))
    slip = jnp.abs(fast) * softness
    rate_z = -slip * slope * lost_b
    # Columns of A: v moves everything, LuGre's z moves its own rate only.
    rate_v = w_v - s_v * jnp.sign(fast) * lost + slip * bend * lost_b * jnp.where(turns, 0.0, level_v)
    if not alone:
        stuck = total(jnp.where(jnp.abs(plays + h * faster(w, w_v)) < limit, 1.0, 0.0))
    if not exact_derivative:
        beside_v, rate_v, rate_z, stuck, slope = jax.lax.stop_gradient(
            (beside_v, rate_v, rate_z, stuck, slope)
        )
    per_mass = gh * mobility
    below_z = 1.0 - gh * rate_z
    coupling = -per_mass * (slope + sigma1 * rate_z)
    below_v = 1.0 + per_mass * (beside_v + sigma1 * rate_v)
    if not alone:
        coupling = first * coupling
        below_v = 1.0 + per_mass * (
            beside_v + sigma1 * (first * rate_v + stuck) + gh * friction.sigma0 * stuck
        )
    heavy = yielding = a2 = free = flank = 0.0
    lasts = False
    if side is not None:
        # With s the slope of w: s (1 + gh C + (gh)^2 K) = a2 - gh K k_d - k_v. What this adds to the row of v:
        heavy = side.ratio / (1.0 - side.ratio)
        a2, touches = contact(side, load)
        # A step that cannot follow the coupling, and flies into a flank or opens a contact between its stages, would be
        # thrown back faster than it came: A then has the coupling from the start, and a contact lasts for the step.
        followed = h * (side.damping + h * side.stiffness) * (1.0 + heavy) < _FOLLOWED
        flank = jnp.sign(load[0]) * side.half_gap
        lasts = (touches > 0.0) & ~followed
        arrives = (jnp.abs(load[0] + h * load[1]) > side.half_gap) & ~followed
        touches = jnp.where(arrives, 1.0, touches)
        # Its own friction is slow and explicit.
        free = side.drag * (v + load[1])
        yielding = touches * (gh * side.damping + gh * gh * side.stiffness)
        below_v = below_v + heavy * yielding / (1.0 + yielding)
    pivot_z = 1.0 / below_z
    pivot_v = below_z / (below_z * below_v - gh * coupling * rate_v)
    arm = coupling * pivot_z

    def solve(right_v, right_z, right_plays, right_d, right_2):
        """Slopes of v, of LuGre's bristle, of the sum over the other elements, and of d and w of a second inertia."""
        drag = 0.0
        if not alone:
            right_v = right_v - per_mass * friction.sigma0 * right_plays
        if side is not None:
            pull = gh * touches * side.stiffness * right_d
            drag = (right_2 - pull) / (1.0 + yielding)
            right_v = right_v + heavy * (pull + yielding * drag)
        k_v = (right_v + arm * right_z) * pivot_v
        k_plays = 0.0 if alone else right_plays + gh * stuck * k_v
        k_w = drag - k_v / (1.0 + yielding) if side is not None else 0.0
        k_d = right_d + gh * k_w if side is not None else 0.0
        return k_v, (right_z + gh * rate_v * k_v) * pivot_z, k_plays, k_d, k_w

    w_load = load[1] if side is not None else 0.0
    k1_v, k1_z, k1_plays, k1_d, k1_w = solve(
        (early - friction_now) * mobility - heavy * a2, rate, moved, w_load, a2 - free
    )
    k1_x = v + gh * k1_v
    x1, v1, z1 = x + h * k1_x, v + h * k1_v, z + h * k1_z
    if drive.has_steep_slip:
        # No stage leaves the deflections up to the present one or that of break-away: beyond, the law was not made.
        reach = jnp.maximum(jnp.abs(z), jnp.maximum(level, friction.Fs) / friction.sigma0)
        z1 = jnp.where(jnp.abs(z1) < reach, z1, jnp.where(z1 > 0.0, reach, -reach))
        k1_z = (z1 - z) / h
    spring_1 = drive.spring_force(z1)
    ahead_hidden = relaxed(hidden, flow[0], flow[1], h) if own else hidden
    now_1 = drive.instant(x1, v1, mean, spring_1, ahead_hidden)
    level_1, w1, s1 = drive.level_at(now_1), drive.bristle_speed(now_1), drive.slip_speed(now_1)
    rate_1 = w1 - jnp.abs(s1) * drive.slip(spring_1 / level_1, s1)
    limit_1 = level_1 * slack
    if not alone:
        middle = plays + h * (0.5 * (w + w1))
        # Both stages have equal weight: this makes their mean, and so the impulse of the damping, exact.
        moved_1 = 2.0 * total(bristles.cut(middle, limit) - plays) / h - moved
        bent_1 = total(bristles.cut(middle, limit_1))
    friction_1 = opposing(spring_1, rate_1, drive.parallel_force(now_1), bent_1, moved_1, drive.sigma1(v1))
    a2_1 = w_load_1 = free_1 = 0.0
    if side is not None:
        load_1 = jnp.stack([load[0] + h * k1_d, w_load + h * k1_w])
        w_load_1 = load_1[1]
        held = -side.stiffness * (load_1[0] - flank) - side.damping * w_load_1
        a2_1 = jnp.where(lasts, held, contact(side, load_1)[0])
        free_1 = side.drag * (v1 + w_load_1)
    k2_v, k2_z, _, k2_d, k2_w = solve(
        (late - friction_1) * mobility - heavy * a2_1 - 2.0 * k1_v,
        rate_1 - 2.0 * k1_z,
        moved_1 - 2.0 * k1_plays,
        w_load_1 - 2.0 * k1_d,
        a2_1 - free_1 - 2.0 * (k1_w + k1_v),
    )
    k2_x = v1 - 2.0 * k1_x + gh * k2_v
    x2, v2 = x + h * (1.5 * k1_x + 0.5 * k2_x), v + h * (1.5 * k1_v + 0.5 * k2_v)
    z2 = z + h * (1.5 * k1_z + 0.5 * k2_z)
    # A step across a reversal at a bristle rate far above 1/h can overshoot the largest deflection of LuGre's bristle.
    # The excess is removed, and with it the impulse of its damping on the mass: J v + sigma1 z is conserved.
    highest = jnp.maximum(jnp.maximum(level, level_1), friction.Fs)
    bound = jax.lax.stop_gradient(LARGEST_YIELD * highest / friction.sigma0)
    if drive.has_steep_slip:
        bound = jax.lax.stop_gradient(jnp.maximum(jnp.abs(z), highest / friction.sigma0))
    excess = z2 - jnp.where(jnp.abs(z2) < bound, z2, jnp.where(z2 > 0.0, bound, -bound))
    v2 = v2 + sigma1 * (excess if alone else first * excess) * mobility
    z2, elements = z2 - excess, state.elements
    if not alone:
        way = x2 - x
        if own:
            way = way - 0.5 * h * ((v - w) + (v1 - w1))
        elements = bristles.cut(plays + way, limit_1)
    following = [hidden]
    if own:
        # Mean source and rate: second order, and stable at any rate.
        flow_1 = drive.relaxation(now_1)
        following = [
            relaxed(hidden, 0.5 * (flow[0] + flow_1[0]), 0.5 * (flow[1] + flow_1[1]), h),
        ]
    if side is not None:
        following.append(load + h * jnp.stack([1.5 * k1_d + 0.5 * k2_d, 1.5 * k1_w + 0.5 * k2_w]))
    return DriveState(x2, v2, z2, elements, jnp.concatenate(following))


def advance(
    drive: Drive,
    bristles: Bristles,
    state: DriveState,
    force: Float[Array, ""] | Push,
    dt: Float[Array, ""],
    substeps: Substeps,
    *,
    exact_derivative: bool = True,
) -> DriveState:
    """Advance by one sample of `dt` s in `substeps` equal steps under the `force` of the sample; see `ros2_step`."""
    if isinstance(substeps, int) and substeps == 1:
        return ros2_step(drive, bristles, state, force, dt, exact_derivative=exact_derivative)
    parts = substeps if isinstance(substeps, int) else substeps.astype(dt.dtype)
    h = dt / parts

    def part(number, now):
        push = force
        if isinstance(force, Push):
            middle = (number + 0.5) / parts - 0.5
            push = Push(force.mean + middle * force.rise, force.rise / parts)
        return ros2_step(drive, bristles, now, push, h, exact_derivative=exact_derivative)

    return jax.lax.fori_loop(0, substeps, part, state)
