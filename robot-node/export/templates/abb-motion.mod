
  ! The motion task T_ROB1: its main routine is sb_robot.
  VAR intnum sb_stop_number;
  VAR intnum sb_moved_number;
  VAR intnum sb_percent_number;
  VAR errnum SB_STOPPED:=-1;
  VAR triggdata sb_trigger;
  VAR bool sb_again;
  VAR num sb_row{6};
  VAR speeddata sb_speed_now;
  VAR zonedata sb_zone_now;
  PERS tooldata sb_tool_now:=[TRUE,[[0,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  PERS wobjdata sb_base_now:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];

  PROC sb_robot()
    BookErrNo SB_STOPPED;
    IDelete sb_stop_number;
    CONNECT sb_stop_number WITH sb_brake;
    IPers sb_stop,sb_stop_number;
    ISleep sb_stop_number;
    IDelete sb_moved_number;
    CONNECT sb_moved_number WITH sb_moved;
    TriggInt sb_trigger,0,sb_moved_number;
    IDelete sb_percent_number;
    CONNECT sb_percent_number WITH sb_refresh;
    IPers sb_percent,sb_percent_number;
    ConfL\Off;
    ConfJ\Off;
    sb_main;
  ENDPROC

  ! Executes the skill until it ends, or until a stop drops it.
  PROC sb_guarded_perform()
    IWatch sb_stop_number;
    sb_perform;
    ISleep sb_stop_number;
  ERROR
    IF ERRNO=SB_STOPPED THEN
      ISleep sb_stop_number;
      RETURN;
    ENDIF
  ENDPROC

  ! HALT, CANCEL and all that stops: brakes, and drops the skill with its motions.
  TRAP sb_brake
    IF sb_stop THEN
      StopMove\Quick;
      ClearPath;
      StartMove;
      RAISE SB_STOPPED;
    ENDIF
  ERROR
    RAISE;
  ENDTRAP

  ! The override acts on motions that are under way too.
  TRAP sb_refresh
    SpeedRefresh DnumToNum(sb_percent);
  ENDTRAP

  ! The frame of `sb_row`.
  FUNC pose sb_frame()
    VAR pose frame;
    VAR num a;
    VAR num b;
    VAR num c;
    frame.trans.x:=sb_row{1};
    frame.trans.y:=sb_row{2};
    frame.trans.z:=sb_row{3};
    a:=sb_row{4};
    b:=sb_row{5};
    c:=sb_row{6};
    frame.rot:=OrientZYX(a,b,c);
    RETURN frame;
  ENDFUNC

  ! Sets what the motion has, in the units of the image.
  PROC sb_prepare(dnum velocity,dnum acceleration,dnum deceleration,dnum approximation,dnum kind,dnum frames)
    VAR num t;
    VAR num w;
    VAR num at;
    VAR num share;
    VAR num zone_mm;
    VAR dnum slower;
    t:=DnumToNum(frames DIV 16);
    w:=DnumToNum(frames MOD 16);
    FOR i FROM 1 TO 6 DO
      at:=6*t+i;
      sb_row{i}:=sb_tools{at};
    ENDFOR
    sb_tool_now.tframe:=sb_frame();
    FOR i FROM 1 TO 6 DO
      at:=6*w+i;
      sb_row{i}:=sb_bases{at};
    ENDFOR
    sb_base_now.uframe:=sb_frame();
    IF kind=2 OR kind=3 THEN
      ! RAPID has no speed of axes: a share of the highest speed of the tool.
      share:=DnumToNum(velocity)/10000;
      sb_speed_now:=[share*MaxRobSpeed(),share*500,5000,1000];
      PathAccLim FALSE,FALSE;
      share:=DnumToNum(acceleration)/100;
      ! AccSet takes 20 % at least.
      IF share<20 THEN
        share:=20;
      ENDIF
      AccSet share,100;
    ELSE
      sb_speed_now:=[DnumToNum(velocity)/10,500,5000,1000];
      AccSet 100,100;
      slower:=deceleration;
      IF slower=0 THEN
        slower:=acceleration;
      ENDIF
      PathAccLim TRUE\AccMax:=DnumToNum(acceleration)/1000,TRUE\DecelMax:=DnumToNum(slower)/1000;
    ENDIF
    zone_mm:=DnumToNum(approximation)/100;
    sb_zone_now:=[approximation=0,zone_mm,1.5*zone_mm,1.5*zone_mm,0.15*zone_mm,1.5*zone_mm,0.15*zone_mm];
  ENDPROC

  FUNC robtarget sb_target(num x,num y,num z,num a,num b,num c)
    VAR robtarget target;
    target.trans:=[x,y,z];
    target.rot:=OrientZYX(a,b,c);
    target.robconf:=[0,0,0,0];
    target.extax:=[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09];
    RETURN target;
  ENDFUNC

  PROC sb_go_line(num x,num y,num z,num a,num b,num c)
    TriggL sb_target(x,y,z,a,b,c),sb_speed_now,sb_trigger,sb_zone_now,sb_tool_now\WObj:=sb_base_now;
  ENDPROC

  PROC sb_go_ptp(num x,num y,num z,num a,num b,num c)
    TriggJ sb_target(x,y,z,a,b,c),sb_speed_now,sb_trigger,sb_zone_now,sb_tool_now\WObj:=sb_base_now;
  ENDPROC

  ! Joints become a target with their configuration: TriggJ takes no joints.
  PROC sb_go_joints(num a1,num a2,num a3,num a4,num a5,num a6)
    VAR jointtarget joints;
    VAR robtarget target;
    joints.robax:=[a1,a2,a3,a4,a5,a6];
    joints.extax:=[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09];
    target:=CalcRobT(joints,sb_tool_now\WObj:=sb_base_now);
    ConfJ\On;
    TriggJ target,sb_speed_now,sb_trigger,sb_zone_now,sb_tool_now\WObj:=sb_base_now;
    ConfJ\Off;
  ENDPROC

  PROC sb_go_circle(num x,num y,num z,num a,num b,num c,num u,num v,num w)
    TriggC sb_target(u,v,w,a,b,c),sb_target(x,y,z,a,b,c),sb_speed_now,sb_trigger,sb_zone_now,sb_tool_now\WObj:=sb_base_now;
  ENDPROC

  ! Gives the motion in the registers to the motion planner.
  PROC sb_move()
    VAR num t{6};
    sb_prepare sb_velocity,sb_acceleration,sb_deceleration,sb_approximation,sb_kind,sb_frames;
    t:=[sb_real(sb_t1),sb_real(sb_t2),sb_real(sb_t3),sb_real(sb_t4),sb_real(sb_t5),sb_real(sb_t6)];
    IF sb_kind=1 THEN
      sb_go_line t{1},t{2},t{3},t{4},t{5},t{6};
    ELSEIF sb_kind=2 THEN
      sb_go_ptp t{1},t{2},t{3},t{4},t{5},t{6};
    ELSEIF sb_kind=3 THEN
      sb_go_joints t{1},t{2},t{3},t{4},t{5},t{6};
    ELSE
      sb_go_circle t{1},t{2},t{3},t{4},t{5},t{6},sb_real(sb_x1),sb_real(sb_x2),sb_real(sb_x3);
    ENDIF
  ENDPROC

  ! By the inverse kinematics of the controller: 0, or error 14 or 15.
  FUNC dnum sb_reach()
    VAR robtarget target;
    VAR jointtarget joints;
    VAR errnum fault;
    IF sb_kind=3 RETURN 0;
    sb_prepare sb_velocity,sb_acceleration,0,sb_approximation,sb_kind,sb_frames;
    target:=sb_target(sb_real(sb_t1),sb_real(sb_t2),sb_real(sb_t3),sb_real(sb_t4),sb_real(sb_t5),sb_real(sb_t6));
    joints:=CalcJointT(target,sb_tool_now\WObj:=sb_base_now\ErrorNumber:=fault);
    IF fault=ERR_ROBLIMIT RETURN 15;
    IF fault<>0 RETURN 14;
    RETURN 0;
  ENDFUNC
