MODULE BtJax
    !***************************************************************************
    ! The robot's side of bt_jax.deploy: loaded into both arms' tasks, T_ROB_L
    ! and T_ROB_R, of an ABB YuMi (IRB 14000) with IRC5 and RobotWare 6.07 or
    ! newer. It was never run on a controller: read it, try it in RobotStudio,
    ! and keep the emergency stop in your hand.
    !
    ! Needed: option 689-1 Externally Guided Motion, the SmartGripper add-in,
    ! and for each arm a UDPUC transmission protocol (Configuration,
    ! Communication) that is named BtJax_L or BtJax_R, with the address of the
    ! computer that runs bt_jax and the port 6511 (left) or 6512 (right).
    !
    ! A person starts the program. Then each arm stands still and tells where
    ! it is (EGM position stream). Only when bt_jax asks for it through Robot
    ! Web Services does the arm follow the setpoints that come over EGM. All
    ! seven axes are guided: on the wire, axes 1 to 6 are the joints and axis
    ! 7, the third from the base, is the external joint (eax_a of a jointtarget).
    !
    ! EGM bypasses much of the controller's supervision.
    !***************************************************************************

    ! Read and written through Robot Web Services. TASK PERS: each arm has its own.
    TASK PERS num egm_motion:=0;    ! see below
    TASK PERS num grip_target:=0;   ! mm of each finger from the middle, 0 to 25
    TASK PERS num grip_force:=10;   ! N, 0 to 20
    TASK PERS num grip_actual:=0;   ! mm of each finger, measured

    ! Values of egm_motion
    LOCAL CONST num LISTEN:=0;      ! stand still, tell the position
    LOCAL CONST num ASKED:=1;       ! bt_jax asks for guided motion
    LOCAL CONST num GUIDED:=2;      ! the arm follows EGM

    LOCAL CONST num PERIOD:=0.05;      ! s between two looks at the gripper
    LOCAL CONST num SAMPLE:=4;         ! ms between two messages
    LOCAL CONST num MAX_SPEED:=15;     ! deg/s that EGM may turn a joint; bt_jax asks for 11.5 at most
    LOCAL CONST num FILTER:=20;        ! Hz, low pass of the setpoints
    LOCAL CONST num SILENT:=1;         ! s without a setpoint after which the arm stops
    LOCAL CONST num RAMP:=0.3;         ! s
    LOCAL CONST num HAND_SPEED:=20;    ! mm/s of a finger
    LOCAL CONST num HAND_STEP:=0.05;   ! mm: smaller changes of the target are none
    LOCAL CONST egm_minmax NEAR:=[-0.1,0.1];  ! deg

    LOCAL VAR egmident egm_id;
    LOCAL VAR num hand_target:=-1;  ! mm, what the gripper was told last

    PROC main()
        egm_motion:=LISTEN;
        prepare_hand;
        stand_still;
        WHILE TRUE DO
            tell_position;
            follow_setpoints;
        ENDWHILE
    ENDPROC

    ! EGM must not be the first motion after a start, and begins at a fine point.
    LOCAL PROC stand_still()
        VAR jointtarget here;
        here:=CJointT();
        MoveAbsJ here,v10,fine,tool0;
    ENDPROC

    ! Sends the position, and moves nothing, until guided motion is asked for.
    LOCAL PROC tell_position()
        connect_egm 100000;  ! nobody answers a stream, so that no silence is too long
        EGMStreamStart egm_id\SampleRate:=SAMPLE;
        WHILE egm_motion<>ASKED DO
            serve_hand;
        ENDWHILE
        EGMStreamStop egm_id;
        EGMReset egm_id;
    ENDPROC

    ! Follows the setpoints until bt_jax asks for the end of it. Where they stay away, the controller stops the program
    ! with an error, which a person acknowledges: with \NoWaitCond it cannot be handled here.
    LOCAL PROC follow_setpoints()
        connect_egm SILENT;
        EGMActJoint egm_id\Tool:=tool0\WObj:=wobj0
            \J1:=NEAR\J2:=NEAR\J3:=NEAR\J4:=NEAR\J5:=NEAR\J6:=NEAR\J7:=NEAR
            \LpFilter:=FILTER\SampleRate:=SAMPLE\MaxSpeedDeviation:=MAX_SPEED;
        EGMRunJoint egm_id,EGM_STOP_HOLD\NoWaitCond\J1\J2\J3\J4\J5\J6\J7
            \CondTime:=1000000\RampInTime:=RAMP\PosCorrGain:=1;
        egm_motion:=GUIDED;
        WHILE egm_motion=GUIDED DO
            serve_hand;
        ENDWHILE
        EGMStop egm_id,EGM_STOP_HOLD\RampOutTime:=RAMP;
        EGMReset egm_id;
        egm_motion:=LISTEN;
    ENDPROC

    ! ROB_ID is the robot of the task that runs this.
    LOCAL PROC connect_egm(num silence)
        EGMReset egm_id;
        EGMGetId egm_id;
        IF GetTaskName()="T_ROB_L" THEN
            EGMSetupUC ROB_ID,egm_id,"default","BtJax_L"\Joint\CommTimeout:=silence;
        ELSE
            EGMSetupUC ROB_ID,egm_id,"default","BtJax_R"\Joint\CommTimeout:=silence;
        ENDIF
    ENDPROC

    LOCAL PROC prepare_hand()
        WHILE NOT Hand_IsCalibrated() DO
            TPWrite "BtJax: calibrate this gripper (closed, SmartGripper app), PP to main, start.";
            Stop;
        ENDWHILE
        Hand_Initialize\maxSpd:=HAND_SPEED\holdForce:=grip_force;
        grip_actual:=Hand_GetActualPos();
        grip_target:=grip_actual;
        hand_target:=grip_actual;
    ENDPROC

    ! Opening goes to the target; closing goes on until something or the end is met, and then holds with the force.
    LOCAL PROC serve_hand()
        VAR num wanted;
        WaitTime PERIOD;
        grip_actual:=Hand_GetActualPos();
        wanted:=grip_target;
        IF wanted<0 wanted:=0;
        IF wanted>25 wanted:=25;
        IF Abs(wanted-hand_target)>HAND_STEP THEN
            IF wanted<hand_target THEN
                Hand_GripInward\holdForce:=grip_force\NoWait;
            ELSE
                Hand_MoveTo wanted\NoWait;
            ENDIF
            hand_target:=wanted;
        ENDIF
    ENDPROC
ENDMODULE
