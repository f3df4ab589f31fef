"""Every threshold of the plausibility checks, with its derivation.

Seven were adjusted after looking at recorded runs of the fake robot: MOVING_SHARE, on runs with frozen signals;
MISREAD_M_S and MISREAD_SHARE, on runs with wrong joints and on ice; FOOT_SPEED_SHARE, FOOT_ERROR_SHARE, the bound for
loads that stand still, and the margin at a joint's stop, on runs without faults. Sizes of ordinary errors are upper
ends of what such sensors and estimators do. Figures of the robot are those of :mod:`spot_model.robot.facts`.
"""

from __future__ import annotations

import math
from typing import Final

from spot_model.robot import facts

WINDOW_S: Final = 0.018
"""A window of states spans at least this: one policy period of 20 ms, less a state of 3 ms that may be early."""

GAP_S: Final = 0.025
"""Two states further apart leave a hole in which nothing is known, so their window is not judged. A stream of 50 Hz is
judged; a slower one loses ticks of the policy."""

# Signals that stand still ---------------------------------------------------------------------------------------------

MOVING_SHARE: Final = 0.5
"""A signal is held to move only while half of its neighbours do: six joints of twelve, the legs of a diagonal."""

POSITION_NOISE_RAD: Final = 1e-4
"""Motion of a neighbour that counts. A joint encoder of 16 bits resolves 2π / 65536 = 1e-4 rad; a signal that moved by
less may truly repeat its value."""

VELOCITY_NOISE_RAD_S: Final = 0.01
"""Velocity of a neighbour that counts: one step of that encoder within 10 ms, over which velocities are formed."""

LOAD_NOISE_NM: Final = 0.05
"""Load of a neighbour that counts. A 12-bit torque sensor over the knee's ±113 N·m resolves 226 / 4096 = 0.055."""

STEPS: Final = 3.0
"""Neighbours that move by less than so many steps of their own sensors say nothing, whatever those resolve: the least
change of any of them shows the step. By three steps in each window, with noise as large, 1 in 8 repeats by chance."""

STILL_WINDOWS: Final = 10
"""Windows in a row, 0.2 s. At a probability of one half for each repetition by chance, 1 in 1000 would be wrong. While
the neighbours move by more than the resolution in each window, a repetition is far less likely."""

QUICK_FACTOR: Final = 50.0
"""Neighbours that move by fifty times the resolution in 20 ms leave no room for repetition by chance, ..."""

QUICK_WINDOWS: Final = 5
"""... so half the time is enough: a joint that turns round at 3 Hz with 0.05 rad passes 200 steps of its encoder."""

LOAD_WINDOWS_STILL: Final = 25
"""A load repeats its value while the motor gives all that it can: not for half a second at any gait."""

# A joint's velocity against the slope of its position -----------------------------------------------------------------

SLOPE_MEMORY_S: Final = 0.2
"""The difference fades with this time constant: about one stride at the quickest gaits (5 Hz)."""

SLOPE_RAD: Final = 0.04
"""Difference that is always allowed. A velocity biased by 0.1 rad/s over the memory makes 0.02 rad. An encoder that is
eccentric by ten minutes of arc adds 0.003 rad, and backlash of 1° between encoder and joint 0.017 rad."""

DRIFT_MEMORY_S: Final = 1.0
"""The same over several strides, in which a drift shows that hides behind such a bias within one."""

DRIFT_RAD: Final = 0.12
"""The same bias over this memory makes 0.1 rad; eccentricity and backlash do not grow with time."""

SLOPE_LAG_S: Final = 0.015
"""Velocities are filtered: a lag of two to four state periods (6 to 12 ms), and half a period of the trapezoid rule. A
lag of τ makes a difference of τ times the change of the velocity, summed and faded as the difference itself is."""

SLOPE_BEND_S: Final = SLOPE_LAG_S**2 / (2.0 * WINDOW_S)
"""Beyond that, a lag leaves its square times half the change of the acceleration. That is this number times the range
of the velocity within a window."""

SLOPE_WINDOWS: Final = 2
"""Windows in a row, so that one state with an impact in it decides nothing."""

# Attitude against turn rate -------------------------------------------------------------------------------------------

TURN_MEMORY_S: Final = 0.5
"""As above; the body turns more slowly than joints do."""

TURN_RAD: Final = 0.06
"""A gyro biased by 0.05 rad/s over the memory makes 0.025 rad, and a scale error of 2 % at 1.5 rad/s 0.015 rad.
Corrections of an estimator by accelerometer and legs, at most 1° within the memory, make 0.017 rad."""

TURN_LAG_S: Final = 0.015
"""Lag between the estimator's attitude and rate, either way; it acts as in joints."""

TURN_BEND_S: Final = TURN_LAG_S**2 / (2.0 * WINDOW_S)
"""As in joints."""

TURN_WINDOWS: Final = 3
"""In a row: a foot that lands turns the body for less than two of them."""

# Attitude against gravity ---------------------------------------------------------------------------------------------

GRAVITY_M_S2: Final = 9.81
GRAVITY_MEMORY_S: Final = 1.0
"""Specific force, less the change of the body's velocity, is averaged over this: several strides of any gait."""

GRAVITY_HOLE_S: Final = 0.0045
"""What was felt in a longer hole between states, one and a half of their periods, is missing from the mean."""

GRAVITY_ANGLE_RAD: Final = 0.25
"""Between averaged specific force and the attitude's vertical. An estimator errs by 3°, mounting by 2°, and a mean
acceleration of 1.5 m/s² that is not seen in the velocity adds 8.7°: 14° in all."""

GRAVITY_LEAST_M_S2: Final = 6.0
"""A shorter average does not contain gravity: the robot reports accelerations without it, and the check is off."""

IMU_ANGLE_RAD: Final = 0.2
"""Between the attitude of the body and that of the inertial unit, which is bolted to it. Of these 11°, 2° are mounting,
3° estimators, and 6° a lag of 20 ms at 5 rad/s."""

IMU_TURN_RATE_RAD_S: Final = 1.0
"""Between the mean turn rates of both over a window: filters' lag of 15 ms at 50 rad/s², 0.75, and biases."""

IMU_TURN_RATE_SHARE: Final = 0.3
"""The same, for what grows with the rate: 15 ms of lag in a swing of 3 Hz are 0.28 of it."""
IMU_WINDOWS: Final = 5
"""In a row, 0.1 s."""

IMU_STAMP_S: Final = 0.1
"""Between the stamp of a packet and that of the joints in the same message, which is sent every 3 ms: five policy
periods."""

IMU_SILENT_WINDOWS: Final = 25
"""Windows in a row without a packet, half a second: those of a link that loses nine states of ten hold some."""

# The body's velocity against feet that stand --------------------------------------------------------------------------

FOOT_SPEED_M_S: Final = 0.5
"""A foot that stands moves by the sum of errors. These are 0.1 m/s of the estimator, 0.35 m (hip to foot) times a
turn-rate error of 0.1 rad/s, and slip of 0.15 m/s. At touch-down, 0.65 m of leg times joint-velocity errors of 0.3
rad/s add to it."""

FOOT_SPEED_SHARE: Final = 0.5
"""The same, for what grows with speed. Feet that lose their grip slide at up to half the body's speed. Beside that,
odometry scale, filters' lag and the rolling of the sole are small."""

FOOT_MEMORY_S: Final = 0.5
"""A stride of a slow gait."""
FOOT_SHARE: Final = 0.75
"""Share of the time with contact in which no foot in contact stands. In flight and at touch-down no foot stands. In
any gait that lands on a foot, one foot stands for at least a quarter of its contact."""

MISREAD_M_S: Final = 0.05
"""Root mean square of the speed at which feet that stand seem to slide, beyond which another reading of the joints is
looked for. Noise of 0.05 rad/s at the joints of a leg, 0.5 m from the foot, makes 0.043."""

MISREAD_SHARE: Final = 1.0 / 3.0
"""Of its square, at most so much is left by the joints as one error of sign or order would have them. Noise of 0.05
m/s stays with any reading, so the error must have made twice its square; feet that truly slide stand by none."""

MISREAD_WINDOWS: Final = 5
"""In a row, 0.1 s: longer than an impact."""

# Contacts -------------------------------------------------------------------------------------------------------------

LEG_M: Final = -(facts.KN_FROM_HY_M[2] + facts.FOOT_FROM_KN_M[2])
LOWEST_HIP_M: Final = 0.25
TRAVEL_M: Final = 1.25 * 2.0 * math.sqrt(LEG_M**2 - LOWEST_HIP_M**2)
"""The body cannot travel further with the same feet on the ground. This is twice the reach of a stretched leg under a
hip at its lowest allowed height, and a quarter more for feet that slide and odometry that errs."""

TRAVEL_MEMORY_S: Final = TRAVEL_M / 0.4
"""The path fades with this time constant: a body that sways at 0.4 m/s for ever, the push of a robot at rest, stays
below the bound."""

AIRBORNE_S: Final = 0.8
"""No foot on the ground for longer than a jump to twice the height of the hips, 0.8 m: 2·sqrt(2·0.8 m / g)."""

# Load against set-point and motion ------------------------------------------------------------------------------------

LOAD_NM: Final = 30.0
"""Difference that is always allowed between the measured load and what the servo law asks. Friction and gear losses
make 10 N·m, a rotor inertia of 0.073 kg·m² at 200 rad/s² 15 N·m, and a sensor's offset 5 N·m."""

LOAD_SHARE: Final = 0.5
"""The same as a share of what is asked. Gains err by 15 %, a sensor's scale by 10 %, and the torque may be limited by
speed, temperature or voltage."""

LOAD_LAG_S: Final = 0.012
"""Position and velocity at which the robot's servo acts are this much older or newer than those reported."""

SETPOINTS: Final = 3
"""A load may answer any of the newest set-points: 20 ms of link and a period of delay are two that are older."""

LOAD_WINDOWS: Final = 5
"""In a row, 0.1 s: longer than an impact, shorter than a step."""

# Load as the answer to what was asked ---------------------------------------------------------------------------------

ANSWER_MEMORY_S: Final = 0.5
"""A stride of a slow gait: in it, what rotors' inertia adds and takes cancels out."""

ANSWER_LEAST_S: Final = 0.5 * ANSWER_MEMORY_S
"""Of it, before anything is judged."""

ANSWER_NM: Final = 15.0
"""Root mean square of a torque that is judged. Gear losses of 10 N·m and a sensor's offset of 5 N·m can neither reverse
such a load nor double it."""

ANSWER_MOST: Final = 2.0
"""Load as a multiple of what was asked, by least squares: gains and sensors err by a quarter of that."""

STOP_RAD: Final = 0.05
"""A joint this near to its stop may lie on it: 1° each of backlash, of an encoder's offset and of a stop that gives
way."""

UNASKED_NM: Final = 10.0
"""Mean load that nobody asked for: a sensor's offset of 5 N·m, and friction of 5 N·m that always acts the same way."""

UNASKED_SHARE: Final = 0.4
"""The same as a share of what is asked: motor and sensor that err by 10 % each, and gears that lose 20 %."""

REPEATED_LOADS: Final = 3
"""Windows in a row, 0.06 s, after which a load that is the same bit for bit says nothing about its joint's position."""

HELD_WINDOWS: Final = 2
"""In a row, while joint control takes hold: the robot is still, so no impact or step is mistaken for an error."""

# The body at rest, before anything is taken over ----------------------------------------------------------------------

REST_SPEED_M_S: Final = 0.4
"""A robot that stands in place sways by some 0.05 m/s; a push that the vendor's stand catches is over in 0.2 s."""

REST_TURN_RATE_RAD_S: Final = 0.6
"""The same push, 0.4 m/s, at the height of the hips."""
REST_JOINT_SPEED_RAD_S: Final = 1.5
"""The same push, by legs of 0.3 m."""
RESTLESS_WINDOWS: Final = 40
"""More than at rest, 0.8 s: a body that a push, or standing up, has set swinging rests by then."""

REST_WINDOWS: Final = 10
"""0.2 s of a robot at rest that carries its weight in a way that cannot be."""

CARRIED_LEAST: Final = 0.3
"""Lower bound of the share that the next one explains."""

CARRIED_MOST: Final = 3.0
"""Force of the ground by the loads of a robot that stands, as a share of its weight. A payload of its own weight and
gear friction of half the load lie between the two bounds; a load of the wrong sign or unit lies outside."""

WEIGHT_N: Final = facts.TOTAL_MASS_KG * GRAVITY_M_S2

SIDEWAYS_SHARE: Final = 1.0
"""Force along the ground on a foot of a robot that stands, as a share of the upward one. Rubber holds this much on dry
concrete (OpenStax, College Physics, table 5.1), and a robot may press its feet apart with all of it. On the vendor's
steepest slope, 30°, a share of 0.58 is its own weight's. Legs taken for others may seem to press harder."""

FOOT_ERROR_SHARE: Final = 0.15
"""Of the weight. Loads that are off by 5 N·m seem to push a foot along the ground by 23 N and upward by 36 N, 0.19
together in the worst case. Friction beyond 0.8 is rare, which leaves a fifth of what a foot carries, 0.04."""

NET_SIDEWAYS_SHARE: Final = 0.35
"""Sum of the forces along the ground, as a share of the weight. A robot at rest has none. Loads that are off by 5 N·m
in the same way at four hips half a metre above the ground make 0.13. Gains that differ by 20 % between front and hind
hips make 0.1, and the legs' own weight and a vertical that is 4° off 0.07 more each."""

TWIST_M: Final = 0.3
"""Height of two diagonal feet over the other two, added up: one foot on a step of 0.3 m, the highest that the vendor
allows."""

FOOT_LEAST_SHARE: Final = 0.1
"""Of the weight on one foot; the direction of a smaller force says little."""

WEIGHT_MEMORY_S: Final = 1.0
"""Mean force of the ground while it walks: over several strides, the weight and what the body's momentum gained."""

WEIGHT_LEAST_S: Final = 0.75 * WEIGHT_MEMORY_S
"""Of it, before anything is judged."""

PULL_SHARE: Final = (facts.TOTAL_MASS_KG - facts.BODY.mass_kg) / facts.N_LEGS / facts.TOTAL_MASS_KG
"""No foot pulls at the ground; a leg that is held up hangs its own weight, 12 % of the robot's, on its joints."""
