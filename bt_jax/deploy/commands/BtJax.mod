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
    ! Once, for each arm, a person runs two routines (PP to routine): with the
    ! fingers closed calibrate_hand, and with the arm where it shall begin
    ! teach_ready.
    !
    ! A person starts the program. The arm must be at its ready target; then it
    ! stands still and tells where it is (EGM position stream). Only when bt_jax
    ! asks for it through Robot Web Services does the arm follow the setpoints
    ! that come over EGM. All seven axes are guided: on the wire, axes 1 to 6
    ! are the joints and axis 7, the third from the base, is the external joint
    ! (eax_a of a jointtarget).
    !
    ! EGM bypasses much of the controller's supervision.
    !***************************************************************************

    ! Read and written through Robot Web Services. TASK PERS: each arm has its own.
    ! bt_jax alone writes what it asks for, and this program alone what it does:
    ! neither can overwrite a request that comes while another is carried out.
    TASK PERS num egm_request:=0;   ! LISTEN or GUIDED, written by bt_jax
    TASK PERS num egm_state:=0;     ! LISTEN or GUIDED, written here
    TASK PERS num egm_here:=0;      ! 1: begin where the arm is (python -m bt_jax.deploy recover), once
    TASK PERS num grip_target:=0;   ! mm of each finger from the middle, 0 to 25
    TASK PERS num grip_force:=10;   ! N, 0 to 20
    TASK PERS num grip_actual:=0;   ! mm of each finger, measured

    ! What the arm carries: kg, centre of gravity in mm from the flange, axes, kg m2. The frame of the tool is the flange's,
    ! as bt_jax expects. Mass of the Smart Gripper and of the heaviest part; the rest is that of a public tooldata of a YuMi.
    ! Measure both with LoadIdentify.
    TASK PERS tooldata gripper:=[TRUE,[[0,0,0],[1,0,0,0]],[$gripper_mass,[8.7,12.3,49.2],[1,0,0,0],0.00021,0.00024,0.00009]];
    TASK PERS loaddata part:=[$part_mass,[0,0,130],[1,0,0,0],0,0,0];

    ! Where the arm begins: no target until a person has taught one with teach_ready
    TASK PERS jointtarget ready:=[[0,0,0,0,0,0],[0,9E9,9E9,9E9,9E9,9E9]];
    TASK PERS bool ready_taught:=FALSE;

    ! Values of egm_request and egm_state
    LOCAL CONST num LISTEN:=0;      ! stand still, tell the position
    LOCAL CONST num GUIDED:=1;      ! follow EGM

    LOCAL CONST num PERIOD:=0.05;      ! s between two looks at the gripper
    LOCAL CONST num SAMPLE:=4;         ! ms between two messages
    LOCAL CONST num MAX_SPEED:=$egm_speed;     ! deg/s that EGM may turn a joint; bt_jax asks for 11.5 at most
    LOCAL CONST num FILTER:=20;        ! Hz, low pass of the setpoints
    LOCAL CONST num SILENT:=1;         ! s without a setpoint after which the arm stops
    LOCAL CONST num RAMP:=0.3;         ! s
    LOCAL CONST num AT_READY:=1;       ! deg that a joint may be from the ready target
    LOCAL CONST num HAND_SPEED:=20;    ! mm/s of a finger
    LOCAL CONST num HAND_STEP:=0.05;   ! mm: smaller changes of the target are none
    LOCAL CONST egm_minmax NEAR:=[-0.1,0.1];  ! deg

    LOCAL VAR egmident egm_id;
    LOCAL VAR bool begin_here:=FALSE;  ! egm_here, as it was when main began
    LOCAL VAR num hand_target:=-1;  ! mm, what the gripper was told last

    ! After an error the program stops; a person who starts it again begins from the start.
    PROC main()
        begin_here:=egm_here=1;
        egm_here:=0;
        egm_request:=LISTEN;
        egm_state:=LISTEN;
        prepare_hand;
        begin_at_ready;
        WHILE TRUE DO
            tell_position;
            follow_setpoints;
        ENDWHILE
    ERROR
        egm_state:=LISTEN;
        TPWrite "BtJax: stopped. PP to main, then start. Error "\Num:=ERRNO;
        Stop;
    ENDPROC

    ! For a person, once: the arm, jogged to where it shall begin, clear of tables and of the other arm.
    PROC teach_ready()
        ready:=CJointT();
        ready_taught:=TRUE;
        TPWrite "BtJax: this arm begins here from now on.";
    ENDPROC

    ! For a person, with nothing near: the arm moves to where it shall begin.
    PROC go_ready()
        IF NOT ready_taught THEN
            TPWrite "BtJax: no ready target. Jog the arm to where it shall begin: teach_ready.";
            RETURN;
        ENDIF
        MoveAbsJ ready\NoEOffs,v50,fine,gripper;
    ENDPROC

    ! For a person, once after power on, with the fingers closed.
    PROC calibrate_hand()
        Hand_JogInward;
        Hand_Initialize\maxSpd:=HAND_SPEED\holdForce:=grip_force\Calibrate;
    ENDPROC

    ! EGM must not be the first motion after a start, and begins at a fine point. The arm is there already.
    PROC begin_at_ready()
        VAR jointtarget here;
        here:=CJointT();
        IF NOT begin_here THEN
            WHILE NOT ready_taught OR joint_gap(here,ready)>AT_READY DO
                IF ready_taught THEN
                    TPWrite "BtJax: not at the ready target. PP to go_ready, then PP to main.";
                ELSE
                    TPWrite "BtJax: no ready target. Jog the arm there, teach_ready, then PP to main.";
                ENDIF
                Stop;
                here:=CJointT();
            ENDWHILE
            here:=ready;
        ENDIF
        MoveAbsJ here\NoEOffs,v10,fine,gripper;
    ERROR
        RAISE;
    ENDPROC

    ! The largest difference of a joint, deg
    FUNC num joint_gap(jointtarget a,jointtarget b)
        VAR num most;
        most:=Abs(a.robax.rax_1-b.robax.rax_1);
        most:=larger_of(most,Abs(a.robax.rax_2-b.robax.rax_2));
        most:=larger_of(most,Abs(a.robax.rax_3-b.robax.rax_3));
        most:=larger_of(most,Abs(a.robax.rax_4-b.robax.rax_4));
        most:=larger_of(most,Abs(a.robax.rax_5-b.robax.rax_5));
        most:=larger_of(most,Abs(a.robax.rax_6-b.robax.rax_6));
        most:=larger_of(most,Abs(a.extax.eax_a-b.extax.eax_a));
        RETURN most;
    ENDFUNC

    FUNC num larger_of(num a,num b)
        IF a>b RETURN a;
        RETURN b;
    ENDFUNC

    ! Sends the position, and moves nothing, until guided motion is asked for.
    PROC tell_position()
        connect_egm 100000;  ! nobody answers a stream, so that no silence is too long
        EGMStreamStart egm_id\SampleRate:=SAMPLE;
        WHILE egm_request<>GUIDED DO
            serve_hand;
        ENDWHILE
        EGMStreamStop egm_id;
        EGMReset egm_id;
    ERROR
        RAISE;
    ENDPROC

    ! Follows the setpoints as long as bt_jax asks for it. Where they stay away, the controller stops the program with an
    ! error, which a person acknowledges: with \NoWaitCond it cannot be handled here.
    PROC follow_setpoints()
        connect_egm SILENT;
        EGMActJoint egm_id\Tool:=gripper\WObj:=wobj0
            \J1:=NEAR\J2:=NEAR\J3:=NEAR\J4:=NEAR\J5:=NEAR\J6:=NEAR\J7:=NEAR
            \LpFilter:=FILTER\SampleRate:=SAMPLE\MaxSpeedDeviation:=MAX_SPEED;
        EGMRunJoint egm_id,EGM_STOP_HOLD\NoWaitCond\J1\J2\J3\J4\J5\J6\J7
            \CondTime:=1000000\RampInTime:=RAMP\PosCorrGain:=1;
        egm_state:=GUIDED;
        WHILE egm_request=GUIDED DO
            serve_hand;
        ENDWHILE
        EGMStop egm_id,EGM_STOP_HOLD\RampOutTime:=RAMP;
        EGMReset egm_id;
        egm_state:=LISTEN;
    ERROR
        RAISE;
    ENDPROC

    ! ROB_ID is the robot of the task that runs this.
    PROC connect_egm(num silence)
        EGMReset egm_id;
        EGMGetId egm_id;
        IF GetTaskName()="T_ROB_L" THEN
            EGMSetupUC ROB_ID,egm_id,"default","BtJax_L"\Joint\CommTimeout:=silence;
        ELSE
            EGMSetupUC ROB_ID,egm_id,"default","BtJax_R"\Joint\CommTimeout:=silence;
        ENDIF
    ERROR
        TPWrite "BtJax: no EGM; look at the transmission protocols BtJax_L and BtJax_R.";
        RAISE;
    ENDPROC

    PROC prepare_hand()
        WHILE NOT Hand_IsCalibrated() DO
            TPWrite "BtJax: gripper not calibrated. Close it, calibrate_hand, then PP to main.";
            Stop;
        ENDWHILE
        Hand_Initialize\maxSpd:=HAND_SPEED\holdForce:=grip_force;
        grip_actual:=Hand_GetActualPos();
        grip_target:=grip_actual;
        hand_target:=grip_actual;
    ERROR
        TPWrite "BtJax: the gripper does not answer; look at the SmartGripper app.";
        RAISE;
    ENDPROC

    ! Opening goes to the target; closing goes on until something or the end is met, and then holds with the force. The
    ! controller is told of the part that is held: at the latest its next motion takes it into account.
    PROC serve_hand()
        VAR num wanted;
        WaitTime PERIOD;
        grip_actual:=Hand_GetActualPos();
        wanted:=grip_target;
        IF wanted<0 wanted:=0;
        IF wanted>25 wanted:=25;
        IF Abs(wanted-hand_target)>HAND_STEP THEN
            IF wanted<hand_target THEN
                Hand_GripInward\holdForce:=grip_force\NoWait;
                GripLoad part;
            ELSE
                Hand_MoveTo wanted\NoWait;
                GripLoad load0;
            ENDIF
            hand_target:=wanted;
        ENDIF
    ERROR
        RAISE;
    ENDPROC
ENDMODULE
