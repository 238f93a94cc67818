/* The functions that read motors and coordinate systems, against a board: what they return is what pmacctl tells.
 * `status turbo` has a Turbo board. */
#include "check.h"

static int turbo;
/* Motor 1 and coordinate system 1 in calls: PMAC_FIRST_MOTOR. */
static int first;

/* Waits until the motor `number` of the board is told to stand at `position`. */
static void reaches(int number, double position)
{
    const int call = first + number - 1;
    for (int tries = 0; tries < 1200; tries++) {
        if (PmacDPRInposition(0, call) && PmacDPRPosition(0, call, 1) == position)
            break;
        Sleep(50);
    }
    EQUAL(PmacDPRPosition(0, call, 1), position);
    CHECK(PmacDPRInposition(0, call));
}

static void reports(void)
{
    CHECK(PmacDPRBackground(0, 1));
    CHECK(PmacDPRBackgroundEx(0, 1, 1, turbo ? 16 : 8));
    CHECK(PmacDPRRealTime(0, 1, 1));
    PmacDPRSetMotors(0, 8);
    PmacDPRRealTimeSetMotor(0, 0xFF);
    CHECK(PmacDPRRealTimeEx(0, 0xFF, 1, 1));
    CHECK(is_live());
    /* The timer counts servo cycles. */
    int before = PmacDPRGetServoTimer(0);
    Sleep(200);
    CHECK(PmacDPRGetServoTimer(0) != before);
}

static void positions(void)
{
    const int two = first + 1;
    send("#2J=3000");
    reaches(2, 3000);
    EQUAL(PmacDPRPosition(0, two, 1), told("motors", 2, "actual_position", "value"));
    EQUAL(PmacDPRPosition(0, two, 0.5), 1500);
    EQUAL(PmacDPRGetCommandedPos(0, two, 1), 3000);
    EQUAL(PmacDPRFollowError(0, two, 1), told("motors", 2, "following_error", "value"));
    EQUAL(PmacDPRGetBiasPos(0, two, 1), told("motors", 2, "position_bias", "value"));
    EQUAL(PmacDPRGetPrevDAC(0, two), (DWORD)told("motors", 2, "previous_dac", "raw"));
    EQUAL(PmacDPRGetVel(0, two, 1), 0);
    EQUAL(PmacFollowError(0, two, 1), PmacDPRFollowError(0, two, 1));
    EQUAL(PmacDPRPosition(0, first + 2, 1), told("motors", 3, "actual_position", "value"));
    if (!turbo) {
        double position = -1;
        EQUAL(PmacDPRGetTargetPos(0, two, 1), 3000);
        PmacDPRGetMasterPos(0, two, 1, &position);
        EQUAL(position, told("motors", 2, "master_position", "value"));
        position = -1;
        PmacDPRGetCompensationPos(0, two, 1, &position);
        EQUAL(position, told("motors", 2, "compensation_position", "value"));
        EQUAL(PmacDPRGetMoveTime(0, two), 0);
        /* The words themselves, and the conversion that a program makes of them. */
        LONG words[2];
        CHECK(PmacDPRGetMem(0, (0xD014 + 15 - 0xD000) * 4, sizeof words, words) == words);
        EQUAL(PmacDPRLFixed(words, 1.0 / (96 * 32)), 3000);
        struct realm block = PmacDPRMotorRealtimeStruct(0, two);
        EQUAL(PmacDPRLFixed(block.apos, 1.0 / (96 * 32)), 3000);
        CHECK(block.sstatus.activated && block.sstatus.desired_vel_0 && block.fvel == 0);
    } else {
        struct realmTURBO block = PmacDPRMotorRealtimeStructTurbo(0, two);
        EQUAL(PmacDPRLFixed(block.pos, 1.0 / (96 * 32)), 3000);
        CHECK(block.sstatus.activated && block.mstatus.in_position);
    }

}

static int near(double got, double expected)
{
    return fabs(got - expected) < 0.02 * expected;
}

/* 32 counts a millisecond: the register counts 1/(Ix09 * 32) count a servo cycle, the vector counts a minute. */
static void velocities(void)
{
    const int two = first + 1;
    send("I222=32 I220=100 I221=0");
    send("#2J+");
    const double expected = 32 * 0.4427 * 96 * 32, minute = 32e3 * 60 * sqrt(2), units[2] = {1, 1};
    const int motors[2] = {two, two};
    double velocity, twice, average, vector;
    for (int tries = 0; tries < 200; tries++) {
        Sleep(50);
        velocity = PmacDPRGetVel(0, two, 1);
        twice = PmacDPRGetVel(0, two, 2);
        average = PmacDPRVelocity(0, two, 1);
        vector = PmacDPRVectorVelocity(0, 2, motors, units);
        if (near(velocity, expected) && near(average, expected))
            break;
    }
    CHECK(near(velocity, expected) && near(twice, 2 * expected) && near(average, expected));
    CHECK(!PmacDPRInposition(0, two));
    /* A Turbo board reports an average alone, whose scale no report tells. */
    if (turbo)
        CHECK(isnan(vector) && PmacDPRVectorVelocity(0, 0, motors, units) == 0);
    else
        CHECK(near(vector, minute));
    send("#2J=0");
    reaches(2, 0);
}

/* The bits of motor 4, killed, and of motor 1, whose loop is closed. */
static void bits(void)
{
    const int one = first, four = first + 3;
    send("#4K");
    send("#1HM");
    for (int tries = 0; tries < 1200; tries++) {
        if (PmacDPRHomeComplete(0, one) && PmacDPRInposition(0, one) && PmacDPROpenLoop(0, four))
            break;
        Sleep(50);
    }
    CHECK(PmacDPROpenLoop(0, four) && !PmacDPROpenLoop(0, one));
    CHECK(!PmacDPRAmpEnabled(0, four) && PmacDPRAmpEnabled(0, one));
    CHECK(PmacDPRMotorEnabled(0, one));
    CHECK(PmacDPRHomeComplete(0, one) && !PmacDPRHomeComplete(0, four));
    for (int motor = 1; motor <= 4; motor++) {
        const int call = first + motor - 1;
        DWORD servo = (DWORD)told("motors", motor, "servo_status", "raw");
        DWORD state = (DWORD)(turbo ? told("motors", motor, "background_status", "raw")
                                    : told("coordinates", motor, "motor_status", "raw"));
        EQUAL(PmacDPRMotorEnabled(0, call), servo >> 23 & 1);
        EQUAL(PmacDPROnNegativeLimit(0, call), servo >> 22 & 1);
        EQUAL(PmacDPROnPositiveLimit(0, call), servo >> 21 & 1);
        EQUAL(PmacDPROpenLoop(0, call), servo >> 18 & 1);
        EQUAL(PmacDPRHomeComplete(0, call), state >> 10 & 1);
        EQUAL(PmacDPROnPositionLimit(0, call), state >> 11 & 1);
        EQUAL(PmacDPRAmpFault(0, call), state >> 3 & 1);
        EQUAL(PmacDPRFatalFError(0, call), state >> 2 & 1);
        EQUAL(PmacDPRWarnFError(0, call), state >> 1 & 1);
        EQUAL(PmacDPRInposition(0, call), state & 1);
        EQUAL(PmacDPRDataBlock(0, call), servo >> 14 & 1);
        EQUAL(PmacDPRPhasedMotor(0, call), servo >> (turbo ? 6 : 19) & 1);
        EQUAL(PmacDPRHandwheelEnabled(0, call), servo >> (turbo ? 4 : 20) & 1);
        /* The functions without DPR in their names say the same. */
        EQUAL(PmacPhasedMotor(0, call), PmacDPRPhasedMotor(0, call));
        EQUAL(PmacAmpEnabled(0, call), PmacDPRAmpEnabled(0, call));
        EQUAL(PmacAmpFault(0, call), PmacDPRAmpFault(0, call));
        EQUAL(PmacFatalFError(0, call), PmacDPRFatalFError(0, call));
        EQUAL(PmacOnNegativeLimit(0, call), PmacDPROnNegativeLimit(0, call));
        EQUAL(PmacOnPositiveLimit(0, call), PmacDPROnPositiveLimit(0, call));
        if (turbo) {
            struct ssTURBO first_word = PmacDPRMotorServoStatusTurbo(0, call);
            struct msTURBO second_word = PmacDPRMotorStatusTurbo(0, call);
            DWORD words[2];
            memcpy(words, &first_word, 4);
            memcpy(words + 1, &second_word, 4);
            EQUAL(words[0] & 0xFFFFFF, servo);
            EQUAL(words[1] & 0xFFFFFF, state);
        }
    }
    send("#4J/");
}

static void systems(void)
{
    char answer[256];
    send("&1");
    send("#1->X");
    send("#2->2Y");
    send("OPEN PROG 18");
    send("CLEAR");
    send("LINEAR ABS TM200");
    send("X1000 Y500");
    send("CLOSE");
    CHECK(PmacGetResponseA(0, answer, sizeof answer, "&1B18R") == 0 && PmacGetError(0) == 0);
    reaches(2, 1000);
    EQUAL(PmacDPRCommanded(0, first, 'X'), 1000);
    EQUAL(PmacDPRCommanded(0, first, 'Y'), told("coordinates", 1, "Y", NULL));
    EQUAL(PmacDPRProgRemaining(0, first), told("coordinates", 1, "lines_remaining", NULL));
    CHECK(PmacDPRPe(0, first) >= 0);
    CHECK(PmacDPRSysInposition(0, first));
    EQUAL(PmacDPRTimeRemInMove(0, first), 0);
    EQUAL(PmacDPRTimeRemInTATS(0, first), 0);
    CHECK(PmacGetError(0) == 0);
}

static void global(void)
{
    unsigned expected[2] = {0, 0};
    DWORD words[2] = {1, 1};
    const char *line = strstr(pmacctl("status"), "global status");
    CHECK(line && sscanf(line, "global status $%x $%x", &expected[0], &expected[1]) == 2);
    if (turbo) {
        struct gsTURBO status;
        memset(&status, 0xFF, sizeof status);
        PmacDPRGetGlobalStatusTurbo(0, &status);
        memcpy(words, &status, sizeof words);
    } else {
        PmacDPRGetGlobalStatus(0, words);
        struct gs status = PmacDPRGlobalStatus(0);
        CHECK(memcmp(words, &status, sizeof words) == 0 && status.host_comm_mode && status.dpram_response);
    }
    /* The DPRAM has the second word of ??? first. */
    CHECK((words[0] & 0xFFFFFF) == expected[1] && (words[1] & 0xFFFFFF) == expected[0]);
}

int main(int count, char **arguments)
{
    const char *motor = getenv("PMAC_FIRST_MOTOR");
    turbo = count > 1 && strcmp(arguments[1], "turbo") == 0;
    first = motor ? atoi(motor) : 0;
    CHECK(OpenPmacDevice(0));
    reports();
    positions();
    velocities();
    bits();
    systems();
    global();
    CHECK(ClosePmacDevice(0));
    return finish("status");
}
