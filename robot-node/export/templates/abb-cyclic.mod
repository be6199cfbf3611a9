
  ! The background task: type Semistatic, its main routine is sb_background.
  VAR clock sb_life_clock;
  VAR clock sb_count_clock;
  VAR jointtarget sb_joints_before;
  CONST string sb_robot_task:="T_ROB1";

  PROC sb_background()
    ClkStart sb_life_clock;
    ClkStart sb_count_clock;
    sb_exchange;
  ENDPROC

  ! Whether no joint has moved since the last call.
  FUNC bool sb_at_rest()
    VAR jointtarget now_joints;
    VAR num way;
    now_joints:=CJointT(\TaskName:=sb_robot_task);
    way:=Abs(now_joints.robax.rax_1-sb_joints_before.robax.rax_1)+Abs(now_joints.robax.rax_2-sb_joints_before.robax.rax_2);
    way:=way+Abs(now_joints.robax.rax_3-sb_joints_before.robax.rax_3)+Abs(now_joints.robax.rax_4-sb_joints_before.robax.rax_4);
    way:=way+Abs(now_joints.robax.rax_5-sb_joints_before.robax.rax_5)+Abs(now_joints.robax.rax_6-sb_joints_before.robax.rax_6);
    sb_joints_before:=now_joints;
    RETURN way<0.001;
  ENDFUNC

  ! Writes joints and pose. A background task does not see the path speed.
  PROC sb_pose()
    VAR jointtarget joints;
    VAR robtarget reached;
    joints:=CJointT(\TaskName:=sb_robot_task);
    SetGO sbo_joint_1,sb_dword(sb_bits(joints.robax.rax_1));
    SetGO sbo_joint_2,sb_dword(sb_bits(joints.robax.rax_2));
    SetGO sbo_joint_3,sb_dword(sb_bits(joints.robax.rax_3));
    SetGO sbo_joint_4,sb_dword(sb_bits(joints.robax.rax_4));
    SetGO sbo_joint_5,sb_dword(sb_bits(joints.robax.rax_5));
    SetGO sbo_joint_6,sb_dword(sb_bits(joints.robax.rax_6));
    reached:=CRobT(\TaskName:=sb_robot_task);
    SetGO sbo_pose_1,sb_dword(sb_bits(reached.trans.x));
    SetGO sbo_pose_2,sb_dword(sb_bits(reached.trans.y));
    SetGO sbo_pose_3,sb_dword(sb_bits(reached.trans.z));
    SetGO sbo_pose_4,sb_dword(sb_bits(EulerZYX(\Z,reached.rot)));
    SetGO sbo_pose_5,sb_dword(sb_bits(EulerZYX(\Y,reached.rot)));
    SetGO sbo_pose_6,sb_dword(sb_bits(EulerZYX(\X,reached.rot)));
    SetGO sbo_path_speed,0;
  ENDPROC
