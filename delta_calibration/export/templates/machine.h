/* $file: corrects joint commands of robot $robot.
 *
 * Printed by delta-cal export $version; edits are lost.
 *   robot         $robot, sha256 $robot_hash
 *   calibration   sha256 $calibration_hash, of session $session
 *   mechanism     $mechanism, commanded as $commanded
 *   effects       $effects
 *   left out      $left_out
 *
 * For a nominal command q the answer is the command at which the identified machine puts its tool
 * where the nominal one meant to: what `delta-cal compensate --method newton` finds. Needs the
 * library of mathematics (-lm) and nothing else; allocates nothing. Never compile it with
 * -ffast-math: guards go by numbers that are not numbers.
 *
 * Joints, in this order ($unit):
$joints
 */

#ifndef ${guard}
#define ${guard}

#ifdef __cplusplus
extern "C" {
#endif

#define ${macro}CORRECT_ROBOT_SHA256 "$robot_hash"
#define ${macro}CORRECT_CALIBRATION_SHA256 "$calibration_hash"
#define ${macro}CORRECT_JOINTS $count
#define ${macro}CORRECT_TEMPERATURES $temperatures
#define ${macro}CORRECT_ROOM $room /* numbers of scratch */

/* What became of a command. */
enum ${prefix}correct_status {
    ${macro}CORRECT_PASSED = 0,            /* corrected */
    ${macro}CORRECT_NOT_FINITE = 1,        /* a joint of the command is not a finite number */
    ${macro}CORRECT_JOINT_LIMIT = 2,       /* beyond a joint's limit, as commanded or as corrected */
    ${macro}CORRECT_OUT_OF_REACH = 3,      /* the nominal machine has no pose there */
    ${macro}CORRECT_OUTSIDE_REGION = 4,    /* outside the calibrated region and its margin */
    ${macro}CORRECT_SINGULAR = 5,          /* near a singularity */
    ${macro}CORRECT_SLACK = 6,             /* a cable would hang slack */
    ${macro}CORRECT_NOT_REACHED = 7,       /* no correction within the bound reaches the target */
    ${macro}CORRECT_MISSING_CONDITION = 8  /* a condition that the machine's effects need is unknown */
};

/* What a command is given under; NAN is "not known". Start from ${prefix}conditions_at_rest. */
typedef struct {
    double rate[$count];          /* of the joints [$unit/s] */
    double acceleration[$count];  /* [$unit/s^2] */
    double direction[$count];     /* sign of each joint's last motion: -1, 1; 0 where not known */
    double time;                  /* not used: a drift is that of the session's end */
    double payload;               /* [kg] */
    double payload_centre[3];     /* [m] in the platform's frame */
$temperature} ${prefix}conditions;

/* Joints stand still, nothing else is known. */
void ${prefix}conditions_at_rest(${prefix}conditions *at);

/* Correct one command.
 *
 * q    nominal command
 * at   its conditions; a null pointer for at rest, nothing known
 * out  what to send: the corrected command, or q itself where the answer is not 0; may be q
 *
 * Uses scratch of its own: one call at a time. The first call prepares it.
 */
int ${prefix}correct(const double *q, const ${prefix}conditions *at, double *out);

/* The same with the caller's scratch of CORRECT_ROOM numbers, one for each thread, that
 * ${prefix}correct_begin has prepared once. */
void ${prefix}correct_begin(double *room);
int ${prefix}correct_in(double *room, const double *q, const ${prefix}conditions *at, double *out);

#ifdef __cplusplus
}
#endif

#endif
